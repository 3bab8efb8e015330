"""The history in a database of time series as a source of readings."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from typing import NamedTuple

from adapters.edge import Converter, Edge
from adapters.errors import SourceError, SourceUnavailable
from adapters.pacing import Pacer
from adapters.reading import Batch, Probe, Reading
from adapters.series.database import Database, Points

_PAGE = 5000
"""Points of a series in one answer at most."""

_LOOK_BACK = 100
"""Steps in which a look at a channel searches its newest value."""


class SeriesChannel(NamedTuple):
    """What a source delivers to one channel."""

    id: str
    """The id of its readings."""
    query: str
    edge: Edge


class SeriesSource:
    """A stretch of a database, from UTC second to UTC second (None: now), as fast as possible or at `pace` times real
    time. There is one reading every `step` s at most."""

    def __init__(
        self,
        name: str,
        database: Database,
        channels: Sequence[SeriesChannel],
        stretch: tuple[float, float | None],
        step: float,
        pace: float | None = None,
    ) -> None:
        self.name = name
        self._database, self._channels, self._stretch = database, tuple(channels), stretch
        self._step, self._pace = step, pace
        self._closed = False

    def check(self) -> list[str]:
        """Nothing: a database is asked when it is read."""
        return []

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """Deliver the readings from UTC second `start` on. Raises SourceUnavailable and SourceConfigError."""
        pacer = Pacer(self._pace)
        converters = [Converter(channel.id, channel.edge) for channel in self._channels]
        first, last = self._stretch
        begin = (first if start is None else max(first, start)) // self._step * self._step
        last = time.time() if last is None else last
        window = (_PAGE if self._pace is None else 1) * self._step
        while begin < last and not self._closed:
            end = min(begin + window, last)
            found = [await self._asked(channel, begin, end) for channel in self._channels]
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

    async def probe(self, seconds: float) -> list[Probe]:
        """The newest value of every channel."""
        end = self._stretch[1] or time.time()
        probes = []
        for channel in self._channels:
            points = await self._asked(channel, end - _LOOK_BACK * self._step, end)
            if not len(points.times):
                raise SourceUnavailable(f"sources.{self.name}: there is no newer value of '{channel.query}'")
            raw, edge = float(points.values[-1]), channel.edge
            value = None if edge.counter else edge.value(raw)
            hints = ("a counter: its differences become power",) if edge.counter else ()
            verdict = "good" if value is None else edge.doubt(value) or "good"
            probes.append(Probe(channel.id, channel.query, f"{raw:g}", value, float(points.times[-1]), verdict, hints))
        return probes

    async def close(self) -> None:
        """End the delivery; safe to call twice."""
        self._closed = True

    async def _asked(self, channel: SeriesChannel, begin: float, end: float) -> Points:
        try:
            return await asyncio.to_thread(self._database.points, channel.query, begin, end, self._step)
        except SourceError as error:
            raise type(error)(f"sources.{self.name}: {error}") from error


def _readings(converter: Converter, points: Points) -> list[Reading]:
    pairs = zip(points.times.tolist(), points.values.tolist(), strict=True)
    return [reading for when, value in pairs if (reading := converter.reading(when, value)) is not None]
