"""A schedule as a source. It delivers nothing: the values of its channels are known for any time (`foreknown`)."""

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from math import inf

from adapters.channel import Binding
from adapters.reading import Batch, Probe, Source

EVERY = 60.0
"""s between two signs of life."""


class ScheduleSource(Source):
    """Channels that follow weeks. There is nothing to connect to."""

    def __init__(self, name: str, table: object, bindings: Sequence[Binding]) -> None:
        self.name = name
        self._closed = asyncio.Event()
        self.rebind(bindings)

    def rebind(self, bindings: Sequence[Binding]) -> None:
        self._channels = [(one.id, one.edge(), one.channel.week) for one in bindings]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """A batch without readings and without a clock every EVERY s, until it is closed."""
        while not self._closed.is_set():
            yield Batch([], -inf)
            try:
                await asyncio.wait_for(self._closed.wait(), EVERY)
            except TimeoutError:
                continue

    async def probe(self, seconds: float) -> list[Probe]:
        now = time.time()
        now_had = [(channel, edge, week.at(now)) for channel, edge, week in self._channels]
        return [Probe(channel, "the schedule", f"{raw:g}", edge.value(raw), now) for channel, edge, raw in now_had]

    async def close(self) -> None:
        self._closed.set()
