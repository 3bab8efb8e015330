"""What the zones of a shard announce, kept for the gateways until they ask for it."""

import asyncio
import secrets
import threading
from collections.abc import Mapping
from contextlib import suppress
from typing import NamedTuple

from service.fleet.messages import News
from service.publish.sinks import Announcement, Occasion, Reports, Sink
from service.zone.zone import Zone

PATIENCE = 2.0
"""How long a gateway is kept waiting for news, s."""
GATHER = 0.05
"""How long news gather before they are told, s: one message for many zones."""
LOOK = 1.0
"""How often it is looked whether a zone's status has changed by itself, as with the time, s."""


_UPDATE = "update"


class _Newest(NamedTuple):
    """All that a zone has told last, and in which version."""

    version: int
    whole: Announcement
    came: Mapping[str, int]
    """The versions that brought its update, and each of its reports."""

    def after(self, known: int) -> Announcement:
        """What is new in it to who knows the version `known`: most of it comes seldom, and costs much to send."""
        told, fresh = self.whole, {name for name, version in self.came.items() if version > known}
        reports = Reports(**{name: report for name, report in told.reports._asdict().items() if name in fresh})
        occasion = told.occasion if _UPDATE in fresh else Occasion.STATUS
        return Announcement(told.site, told.zone, told.state, occasion, reports)


class Outbox(Sink):
    """The newest of every zone. A gateway that is slow misses what was overtaken, and nothing waits for it."""

    def __init__(self, site: str) -> None:
        self._site, self._boot = site, secrets.token_hex(8)
        self.zones: Mapping[str, Zone] = {}
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._version = 0
        self._newest: dict[str, _Newest] = {}
        """In the order of their versions."""
        self._arrived = asyncio.Event()
        self.refused: dict[str, str] = {}

    def remove(self, zone: str) -> None:
        """Its news are nobody's any more."""
        with self._lock:
            self._newest.pop(zone, None)

    def publish(self, announcement: Announcement) -> None:
        """Keep what a zone has to tell, and with it what its last word had that this one leaves out."""
        if announcement.zone in self.zones:
            self._keep(announcement)

    async def news(self, boot: str, since: int) -> News:
        """What is newer than `since`, as soon as there is any, or nothing after PATIENCE."""
        known = since if boot == self._boot else 0
        if boot == self._boot and self._version <= known:
            self._arrived.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(PATIENCE):
                    await self._arrived.wait()
                    await asyncio.sleep(GATHER)
        with self._lock:
            version, fresh = self._version, []
            for newest in reversed(self._newest.values()):
                if newest.version <= known:
                    break
                fresh.append(newest.after(known))
        return News(self._boot, version, fresh[::-1], dict(self.refused))

    async def watch(self) -> None:
        """Notice, for ever, what changes without an announcement."""
        while True:
            await asyncio.sleep(LOOK)
            for name, zone in self.zones.items():
                state, told = zone.now(), self._newest.get(name)
                if told is None or told.whole.status._replace(now=None) != state.status._replace(now=None):
                    self._keep(Announcement(self._site, name, state, Occasion.STATUS))

    def _keep(self, news: Announcement) -> None:
        with self._lock:
            self._version += 1
            before = self._newest.pop(news.zone, None) or _Newest(0, news, {})
            brought = [name for name, report in news.reports._asdict().items() if report is not None]
            occasion = before.whole.occasion
            if news.occasion is not Occasion.STATUS:
                occasion, brought = news.occasion, [_UPDATE, *brought]
            reports = news.reports.beside(before.whole.reports)
            whole = Announcement(self._site, news.zone, news.state, occasion, reports)
            self._newest[news.zone] = _Newest(
                self._version, whole, {**before.came, **dict.fromkeys(brought, self._version)}
            )
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._arrived.set)
