"""Where a shard takes what the reader has read for it: sources to its zones, as if the shard had read them itself."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Collection, Mapping
from math import inf

from adapters.reading import Batch, Probe, Reading, Source
from service.config.site import Config
from service.errors import Away
from service.zone.zone import Zone

PATIENCE = 20.0
"""How long live zones wait, after a start, for what the reader keeps for them, s."""

_END = object()

_log = logging.getLogger(__name__)


class Inlets:
    """The sources of a shard (`service.daemon.supply.feeds.Supply`): what is posted it takes itself, all else is handed
    over by `deliver`."""

    def __init__(self, zones: Mapping[str, Zone]) -> None:
        self._zones = zones
        self._open: dict[str, set[_Inlet]] = {}
        """The inlets of every source that have not come to their end."""
        self._seen: dict[str, float] = {}
        """The latest clock of every source: what is not later may have been delivered before."""
        self._ended: set[str] = set()
        """Sources that have come to their end for all zones that there were then."""
        self._caught_up: set[str] = set()
        self._news = asyncio.Event()
        self._withheld: frozenset[str] = frozenset()

    def build(self, config: Config, name: str) -> Source:
        """The source `name` for the zones of `config`."""
        if config.sources[name].kind == "http":
            return config.build_source(name)
        inlet = _Inlet(name, _channels(config, name), self._closed)
        self._open.setdefault(name, set()).add(inlet)
        return inlet

    def rebind(self, config: Config, name: str, source: Source) -> None:
        """Let a source at work deliver to the zones of `config`."""
        if isinstance(source, _Inlet):
            source.channels = _channels(config, name)
        else:
            config.rebind_source(name, source)

    async def caught_up(self) -> None:
        """Return once the reader has handed over what it kept of every source at work, or cannot be waited for."""
        try:
            async with asyncio.timeout(PATIENCE):
                while not self._caught_up >= self._open.keys():
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            missing = ", ".join(sorted(self._open.keys() - self._caught_up))
            _log.warning("the reader does not deliver %s; time passes without", missing)

    def settle(self, source: str) -> None:
        """The reader keeps nothing of the source that the zones do not have."""
        self._caught_up.add(source)
        self._news.set()

    async def deliver(self, source: str, batch: Batch, again: bool) -> None:
        """Hand a batch, which they may have had `again`, to the zones; what closed by it is durable on return. Raises
        Away where the source is not at work yet."""
        inlets = tuple(self._open.get(source, ()))
        if not inlets and source in self._ended:
            # The zones have had all of it.
            return
        if not inlets or not all(inlet.at_work for inlet in inlets):
            raise Away(f"sources.{source} is not at work in this shard yet")
        if again or batch.now <= self._seen.get(source, -inf):
            batch = Batch([reading for reading in batch.readings if self._is_new(reading)], batch.now)
        await asyncio.gather(*(inlet.put(batch) for inlet in inlets))
        self._seen[source] = max(batch.now, self._seen.get(source, -inf))

    async def finish(self, source: str) -> None:
        """The source has come to its end, also for zones that came to it after it had for others."""
        self._ended.add(source)
        for inlet in self._open.get(source, ()):
            inlet.end()

    def withhold(self, config: Config) -> None:
        """The zones of `config` are not run here and have no other shard yet: what their sources deliver is wanted from
        wherever they stopped."""
        self._withheld = frozenset(name for name in config.sources if config.zones_of(name))

    async def durable_until(self, source: str, config: Config) -> float | None:
        """UTC s up to which all that the zones of `config` had from the source is durable; None where one has not
        begun, -inf where it cannot be told."""
        if source in self._withheld:
            return -inf
        zones = [self._zones[zone.id] for zone in config.zones_of(source) if zone.id in self._zones]
        known = await asyncio.gather(*(zone.intake.durable_until() for zone in zones))
        times = [time for time in known if time is not None]
        return min(times, default=inf) if len(times) == len(known) else None

    def _is_new(self, reading: Reading) -> bool:
        name = reading.channel.split("/", 1)[0]
        return name in self._zones and not self._zones[name].intake.knows(reading)

    def _closed(self, inlet: _Inlet) -> None:
        self._open[inlet.name].discard(inlet)


class _Inlet:
    """A source that somebody else reads."""

    def __init__(self, name: str, channels: Collection[str], closed: Callable[[_Inlet], None]) -> None:
        self.name = name
        self.channels = channels
        self.at_work = False
        """Whether somebody takes what is put."""
        self._closed = closed
        self._batches: asyncio.Queue[tuple[Batch, asyncio.Future[None]] | object] = asyncio.Queue()

    def check(self) -> list[str]:
        """What the reader looks at."""
        return []

    async def put(self, batch: Batch) -> None:
        """Hand over the readings of the inlet's channels, and return once the zones have taken them."""
        taken: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        own = [reading for reading in batch.readings if reading.channel in self.channels]
        self._batches.put_nowait((Batch(own, batch.now), taken))
        await taken

    def end(self) -> None:
        """Nothing follows what was put."""
        self._batches.put_nowait(_END)

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """What is put, in order, until the end. The reader knows where to begin."""
        self.at_work = True
        taken: asyncio.Future[None] | None = None
        try:
            while (item := await self._batches.get()) is not _END:
                assert isinstance(item, tuple)
                batch, taken = item
                yield batch
                if not taken.done():
                    taken.set_result(None)
        finally:
            self.at_work = False
            self._give_up(taken)
            while not self._batches.empty():
                item = self._batches.get_nowait()
                self._give_up(item[1] if isinstance(item, tuple) else None)

    async def probe(self, seconds: float) -> list[Probe]:
        """Nothing to look at here."""
        return []

    async def close(self) -> None:
        """The reader holds the connection; nothing is wanted of it for these zones any more."""
        self._closed(self)

    def _give_up(self, taken: asyncio.Future[None] | None) -> None:
        if taken is not None and not taken.done():
            taken.set_exception(Away(f"sources.{self.name} has not been taken by its zones"))


def _channels(config: Config, name: str) -> frozenset[str]:
    return frozenset(binding.id for binding in config.bindings(name))
