"""The history in a database of time series as a source of readings."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Sequence

from adapters.channel import Binding
from adapters.edge import Converter, newest
from adapters.errors import SourceUnavailable, said_of
from adapters.pacing import Pacer
from adapters.reading import Batch, Probe, Reading
from adapters.series.config import HistoryConfig
from adapters.series.database import Points

_PAGE = 5000
"""Points of a series in one answer at most."""

_LOOK_BACK = 100
"""Steps in which a look at a channel searches its newest value."""


class SeriesSource:
    """A stretch of a database, as fast as possible or at a pace, with one reading every step at most."""

    def __init__(self, name: str, table: HistoryConfig, bindings: Sequence[Binding]) -> None:
        self.name = name
        self._table, self._database, self._step = table, table.asked, table.step
        self._channels = [(one.id, one.channel.address, one.edge()) for one in bindings]
        """Of each channel its id, its query and its edge."""
        self._closed = False

    def check(self) -> list[str]:
        """Nothing: a database is asked when it is read."""
        return []

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """Deliver the readings from UTC second `start` on. Raises SourceUnavailable and SourceConfigError."""
        pacer, first = Pacer(self._table.multiple), self._table.begin
        converters = [Converter(channel, edge) for channel, _, edge in self._channels]
        begin = (first if start is None else max(first, start)) // self._step * self._step
        last = time.time() if self._table.end is None else self._table.end
        window = (_PAGE if self._table.multiple is None else 1) * self._step
        try:
            while begin < last and not self._closed:
                end = min(begin + window, last)
                found = [await self._asked(query, begin, end) for _, query, _ in self._channels]
                await pacer.wait(end, lambda: self._closed)
                readings = [
                    reading
                    for converter, points in zip(converters, found, strict=True)
                    for reading in _readings(converter, points)
                ]
                if self._closed:
                    return
                yield Batch(sorted(readings, key=lambda reading: reading.time), end)
                begin = end
        finally:
            # The next look may be in another event loop.
            await self._database.close()

    async def probe(self, seconds: float) -> list[Probe]:
        """The newest value of every channel."""
        end = self._table.end or time.time()
        probes = []
        for channel, query, edge in self._channels:
            points = await self._asked(query, end - _LOOK_BACK * self._step, end)
            if not len(points.times):
                raise SourceUnavailable(f"sources.{self.name}: there is no newer value of '{query}'")
            probes.append(newest(channel, query, edge, float(points.values[-1]), float(points.times[-1])))
        return probes

    async def close(self) -> None:
        """End the delivery; safe to call twice."""
        self._closed = True
        await self._database.close()

    async def _asked(self, query: str, begin: float, end: float) -> Points:
        with said_of(self.name):
            return await self._database.points(query, begin, end, self._step)


def _readings(converter: Converter, points: Points) -> list[Reading]:
    pairs = zip(points.times.tolist(), points.values.tolist(), strict=True)
    return [reading for when, value in pairs if (reading := converter.reading(when, value)) is not None]
