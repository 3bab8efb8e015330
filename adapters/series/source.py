"""The history in a database as a source of readings."""

from collections.abc import AsyncIterator, Sequence
from math import inf
from pkgutil import resolve_name

from adapters.channel import Binding
from adapters.edge import Converter, looked_at
from adapters.errors import SourceUnavailable, said_of
from adapters.playback import RecordedSource
from adapters.reading import Batch, Probe, Reading
from adapters.series.config import HistoryConfig

_PAGE = 5000
"""Points of a series in one answer at most."""


class SeriesSource(RecordedSource):
    """A stretch of a database, as fast as possible or at a pace."""

    def __init__(self, name: str, table: HistoryConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, table, bindings)
        self._step, self._database = table.step, resolve_name(table.asked)(table)
        self._channels = [binding.channel for binding in bindings]

    def check(self) -> list[str]:
        return [f"sources.{self.name}: {problem}" for problem in self._database.problems(self._channels)]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        converters = [Converter(*one) for one in self._edges]
        window = (_PAGE if self._pace == inf else 1) * self._step
        self._origin = None
        try:
            with said_of(self.name):
                first, last = await self._database.span(self._channels)
                begin = (first if start is None else max(first, start)) // self._step * self._step
                while begin < last and not self._closed:
                    end = min(begin + window, last)
                    readings = await self._read(converters, begin, end)
                    if not await self._due(end):
                        return
                    wanted = (one for one in readings if start is None or not one.time < start)
                    yield Batch(sorted(wanted, key=lambda reading: reading.time), end)
                    begin = end
        finally:
            # The next look may be in another event loop.
            await self._database.close()

    async def _read(self, converters: Sequence[Converter], begin: float, end: float) -> list[Reading]:
        """The readings of all channels in [begin, end), UTC s."""
        found: list[Reading] = []
        for converter, channel in zip(converters, self._channels, strict=True):
            points = await self._database.points(channel, begin, end, converter.edge.counter)
            pairs = zip(points.times.tolist(), points.values.tolist(), strict=True)
            found += [one for when, value in pairs if (one := converter.reading(when, value)) is not None]
        return found

    async def probe(self, seconds: float) -> list[Probe]:
        probes = []
        with said_of(self.name):
            for (id, edge), channel in zip(self._edges, self._channels, strict=True):
                points = await self._database.newest(channel)
                if not len(points.times):
                    raise SourceUnavailable(f"there is no newer value of '{channel.address}'")
                place = channel.address
                probes.append(looked_at(id, place, edge, float(points.values[-1]), float(points.times[-1])))
        return probes

    async def close(self) -> None:
        await super().close()
        await self._database.close()
