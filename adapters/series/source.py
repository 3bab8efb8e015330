"""The history in a database of time series as a source of readings."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Sequence

from adapters.channel import Binding
from adapters.edge import Converter, looked_at
from adapters.errors import SourceUnavailable, said_of
from adapters.playback import RecordedSource
from adapters.reading import Batch, Probe, Reading
from adapters.series.config import HistoryConfig
from adapters.series.database import Points

_PAGE = 5000
"""Points of a series in one answer at most."""

_LOOK_BACK = 100
"""Steps in which a look at a channel searches its newest value."""


class SeriesSource(RecordedSource):
    """A stretch of a database, as fast as possible or at a pace, with one reading every step at most."""

    def __init__(self, name: str, table: HistoryConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, table, bindings)
        self._table, self._database, self._step = table, table.asked, table.step
        self._queries: list[str] = [one.channel.address for one in bindings]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """Deliver the readings from UTC second `start` on. Raises SourceUnavailable and SourceConfigError."""
        converters = [Converter(*one) for one in self._edges]

        async def read(begin: float, end: float) -> list[Reading]:
            found = [await self._asked(query, begin, end) for query in self._queries]
            values = (
                converter.reading(when, value)
                for converter, points in zip(converters, found, strict=True)
                for when, value in zip(points.times.tolist(), points.values.tolist(), strict=True)
            )
            return [reading for reading in values if reading is not None]

        first = self._table.begin if start is None else max(self._table.begin, start)
        last = time.time() if self._table.end is None else self._table.end
        window = (_PAGE if self._pace is None else 1) * self._step
        try:
            async for batch in self._played(first // self._step * self._step, last, window, read):
                yield batch
        finally:
            # The next look may be in another event loop.
            await self._database.close()

    async def probe(self, seconds: float) -> list[Probe]:
        """The newest value of every channel."""
        end = self._table.end or time.time()
        probes = []
        for (channel, edge), query in zip(self._edges, self._queries, strict=True):
            points = await self._asked(query, end - _LOOK_BACK * self._step, end)
            if not len(points.times):
                raise SourceUnavailable(f"sources.{self.name}: there is no newer value of '{query}'")
            probes.append(looked_at(channel, query, edge, float(points.values[-1]), float(points.times[-1])))
        return probes

    async def close(self) -> None:
        """End the delivery; safe to call twice."""
        await super().close()
        await self._database.close()

    async def _asked(self, query: str, begin: float, end: float) -> Points:
        with said_of(self.name):
            return await self._database.points(query, begin, end, self._step)
