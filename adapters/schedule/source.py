"""A schedule as a live source: what it has now, again and again."""

import asyncio
import time
from collections.abc import AsyncIterator, Sequence

from adapters.channel import Binding
from adapters.edge import Converter
from adapters.reading import Batch, Probe, Source

EVERY = 60.0
"""s between two readings: an interval in which the value changes has its mean."""


class ScheduleSource(Source):
    """Channels that follow weeks. There is nothing to connect to."""

    def __init__(self, name: str, table: object, bindings: Sequence[Binding]) -> None:
        self.name = name
        self._closed = asyncio.Event()
        self.rebind(bindings)

    def rebind(self, bindings: Sequence[Binding]) -> None:
        self._channels = [(Converter(one.id, one.edge()), one.channel.week) for one in bindings]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """The values of now, every EVERY s, until it is closed."""
        while not self._closed.is_set():
            now = time.time()
            readings = (converter.reading(now, week.at(now)) for converter, week in self._channels)
            yield Batch([reading for reading in readings if reading is not None], now)
            try:
                await asyncio.wait_for(self._closed.wait(), EVERY - time.time() % EVERY)
            except TimeoutError:
                continue

    async def probe(self, seconds: float) -> list[Probe]:
        now = time.time()
        now_had = [(converter, week.at(now)) for converter, week in self._channels]
        return [Probe(one.channel, "the schedule", f"{raw:g}", one.edge.value(raw), now) for one, raw in now_had]

    async def close(self) -> None:
        self._closed.set()
