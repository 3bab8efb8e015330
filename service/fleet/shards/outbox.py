"""What the zones of a shard announce, kept for the gateways until they ask for it."""

import asyncio
import secrets
import threading
from collections.abc import Mapping
from contextlib import suppress

from service.fleet.messages import News
from service.publish.sinks import Announcement, Occasion, Sink
from service.zone.zone import Zone

PATIENCE = 2.0
"""How long a gateway is kept waiting for news, s."""
GATHER = 0.05
"""How long news gather before they are told, s: one message for many zones."""
LOOK = 1.0
"""How often it is looked whether a zone's status has changed by itself, as with the time, s."""


class Outbox(Sink):
    """The newest of every zone. A gateway that is slow misses what was overtaken, and nothing waits for it."""

    def __init__(self, site: str) -> None:
        self._site, self._boot = site, secrets.token_hex(8)
        self.zones: Mapping[str, Zone] = {}
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._version = 0
        self._newest: dict[str, tuple[int, Announcement]] = {}
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
            for at, news in reversed(self._newest.values()):
                if at <= known:
                    break
                fresh.append(news)
        return News(self._boot, version, fresh[::-1], dict(self.refused))

    async def watch(self) -> None:
        """Notice, for ever, what changes without an announcement."""
        while True:
            await asyncio.sleep(LOOK)
            for name, zone in self.zones.items():
                state, told = zone.now(), self._newest.get(name)
                if told is None or told[1].status._replace(now=None) != state.status._replace(now=None):
                    self._keep(Announcement(self._site, name, state, Occasion.STATUS))

    def _keep(self, news: Announcement) -> None:
        with self._lock:
            self._version += 1
            _, before = self._newest.pop(news.zone, (0, news))
            occasion = before.occasion if news.occasion is Occasion.STATUS else news.occasion
            whole = Announcement(self._site, news.zone, news.state, occasion, news.reports.beside(before.reports))
            self._newest[news.zone] = self._version, whole
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._arrived.set)
