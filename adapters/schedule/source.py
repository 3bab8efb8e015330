"""A schedule as a live source: what it has now, again and again."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from typing import NamedTuple

from adapters.edge import Converter, Edge
from adapters.reading import Batch, Probe
from adapters.schedule.week import Week

EVERY = 60.0
"""s between two readings: an interval in which the value changes has its mean."""


class ScheduleChannel(NamedTuple):
    """The channel `id` ("zone/channel"), the week that it follows, and what becomes of its values."""

    id: str
    week: Week
    edge: Edge


class ScheduleSource:
    """Channels that follow weeks. There is nothing to connect to."""

    def __init__(self, name: str, channels: Sequence[ScheduleChannel]) -> None:
        self.name = name
        self._channels = tuple(channels)
        self._closed = asyncio.Event()

    def check(self) -> list[str]:
        """Nothing can be wrong that its tables do not tell."""
        return []

    def rebind(self, channels: Sequence[ScheduleChannel]) -> None:
        """These are the channels from now on."""
        self._channels = tuple(channels)

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """The values of now, every EVERY s, until it is closed."""
        while not self._closed.is_set():
            now = time.time()
            readings = (Converter(one.id, one.edge).reading(now, one.week.at(now)) for one in self._channels)
            yield Batch([reading for reading in readings if reading is not None], now)
            try:
                await asyncio.wait_for(self._closed.wait(), EVERY - time.time() % EVERY)
            except TimeoutError:
                continue

    async def probe(self, seconds: float) -> list[Probe]:
        """What every channel has now."""
        now = time.time()
        found = []
        for one in self._channels:
            raw = one.week.at(now)
            found.append(Probe(one.id, "the schedule", f"{raw:g}", one.edge.value(raw), now))
        return found

    async def close(self) -> None:
        """End the delivery; safe to call twice."""
        self._closed.set()
