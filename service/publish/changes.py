"""Which zones have news, for the clients that watch all of them at once.

A watcher holds the names of the zones that changed since it last looked, and nothing of what they announced: however
slowly a client reads and however many zones there are, that is bounded.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from service.pauses import within
from service.publish.events import KEEP_ALIVE
from service.publish.sinks import Announcement
from service.records.measures import Measure


class Watcher:
    """What changed since one client last looked."""

    def __init__(self) -> None:
        self._over = asyncio.Event()
        self._changed: dict[str, None] = {}
        self._news = asyncio.Event()

    @property
    def ended(self) -> bool:
        """Whether nothing will change any more."""
        return self._over.is_set()

    def note(self, zone: str) -> None:
        """`zone` has news, or is gone."""
        self._changed[zone] = None
        self._news.set()

    def end(self) -> None:
        """Nothing will change any more."""
        self._over.set()
        self._news.set()

    async def rest(self, seconds: float) -> None:
        """Let news gather for so long, or until the end."""
        await within(self._over, seconds)

    async def changed(self) -> list[str]:
        """The zones with news, longest ago first, once there are any; none after KEEP_ALIVE s without."""
        await within(self._news, KEEP_ALIVE)
        self._news.clear()
        changed, self._changed = list(self._changed), {}
        return changed


class Changes:
    """The watchers of all zones, which come and go in the event loop: a sink."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._watchers: set[Watcher] = set()
        self._ended = False

    @contextmanager
    def watched(self) -> Iterator[Watcher]:
        """A watcher of what changes from now on, for as long as the context lasts."""
        self._loop = asyncio.get_running_loop()
        watcher = Watcher()
        if self._ended:
            watcher.end()
        self._watchers.add(watcher)
        try:
            yield watcher
        finally:
            self._watchers.discard(watcher)

    def note(self, zone: str) -> None:
        """There is news of `zone`; called in the event loop."""
        for watcher in self._watchers:
            watcher.note(zone)

    def end(self) -> None:
        """End all watching, for good, as the daemon stops; called in the event loop."""
        self._ended = True
        for watcher in self._watchers:
            watcher.end()

    def add(self, zone: str) -> None:
        """A zone has come."""
        self._tell(zone)

    def remove(self, zone: str) -> None:
        """A zone has gone."""
        self._tell(zone)

    def publish(self, announcement: Announcement) -> None:
        """A zone has something to tell."""
        self._tell(announcement.zone)

    def settle(self) -> None:
        """Nobody is waited for."""

    def measures(self) -> list[Measure]:
        """Streams are counted where their number is bounded."""
        return []

    def close(self) -> None:
        """End all watching, for good."""
        if self._loop is not None:
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self.end)

    def _tell(self, zone: str) -> None:
        if self._loop is not None and self._watchers:
            # Where the loop is gone, so are the clients.
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self.note, zone)
