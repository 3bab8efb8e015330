"""What the loads of all sources share: a process of devices beside the one that reads, and what reading costs it."""

from __future__ import annotations

import asyncio
import multiprocessing
import resource
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

SETTLING = 3.0
"""Seconds before the measurement begins, in which every connection is made and every buffer filled once."""
PATIENCE = 120.0
"""How much longer than asked for is measured, where no poll has come to its end, s."""
MOST_GROWTH = 5.0
"""MB that memory may grow by; the arrival times that are kept for the report are part of it."""


@dataclass(frozen=True)
class Cost:
    """What reading cost its process."""

    seconds: float
    cpu: float
    """Share of one processor."""
    memory_before: float
    memory_after: float
    """Resident memory in MB."""

    @property
    def grew(self) -> bool:
        """Whether memory has grown by more than it may."""
        return self.memory_after > self.memory_before + MOST_GROWTH

    def lines(self) -> list[str]:
        """For a person."""
        return [
            f"processor {100 * self.cpu:.1f} % of one core",
            f"memory {self.memory_before:.1f} MB before, {self.memory_after:.1f} MB after",
        ]


@dataclass(frozen=True)
class Polled:
    """What was measured of devices that are polled."""

    devices: int
    channels: int
    polls: int
    missed: int
    """Polls that should have been made and were not."""
    readings: int
    worst_gap: float
    """Longest time between two answers of a device, in polls."""
    cost: Cost

    @property
    def good(self) -> bool:
        """Whether no poll was missed, each has brought every reading, and memory has not grown."""
        return not self.missed and self.readings == self.polls * self.channels and not self.cost.grew

    def lines(self) -> list[str]:
        """For a person."""
        return [
            f"{self.devices} devices x {self.channels} points for {self.cost.seconds:.0f} s",
            f"polls {self.polls}, missed {self.missed}, readings {self.readings}, worst gap {self.worst_gap:.2f} polls",
            *self.cost.lines(),
        ]


async def polled(sources: Sequence[Any], devices: int, channels: int, seconds: float, poll: float) -> Polled:
    """Read `sources` of so many devices, whose channels are "d<number>/...", for `seconds`."""
    arrivals: dict[str, list[float]] = {f"d{device}": [] for device in range(devices)}
    counts: list[int] = []

    async def follow(source: Any) -> None:
        async for batch in source.batches(None):
            counts.append(sum(reading.fault is None for reading in batch.readings))
            arrivals[batch.readings[0].channel.split("/")[0]].append(asyncio.get_running_loop().time())

    def late() -> int:
        return sum(source.late for source in sources)

    tasks = [asyncio.create_task(follow(source)) for source in sources]
    await asyncio.sleep(2 * poll + min(SETTLING, seconds))
    for kept in (*arrivals.values(), counts):
        kept.clear()
    before, meter = late(), Meter()
    await asyncio.sleep(seconds)
    # Of a few seconds on a busy machine, too, there is something to tell.
    while not all(arrivals.values()) and meter.seconds < seconds + PATIENCE:
        await asyncio.sleep(poll)
    cost, missed = meter.read(), late() - before
    for task in tasks:
        task.cancel()
    outcomes = await asyncio.gather(*tasks, return_exceptions=True)
    failures = [outcome for outcome in outcomes if not isinstance(outcome, asyncio.CancelledError)]
    if failures:
        raise RuntimeError(f"{len(failures)} of {len(tasks)} sources failed: {failures[0]!r}")
    expected = int(cost.seconds / poll)
    gaps = [later - earlier for arrived in arrivals.values() for earlier, later in pairwise(arrived)]
    return Polled(
        devices=devices,
        channels=channels,
        polls=sum(map(len, arrivals.values())),
        missed=missed + sum(max(0, expected - len(arrived)) for arrived in arrivals.values()),
        readings=sum(counts),
        worst_gap=max(gaps, default=0.0) / poll,
        cost=cost,
    )


class Meter:
    """Reads the cost of this process since it was made."""

    def __init__(self) -> None:
        self._cpu, self._began = time.process_time(), time.monotonic()
        self.memory = _resident_memory()

    @property
    def seconds(self) -> float:
        """Since it was made."""
        return time.monotonic() - self._began

    def read(self) -> Cost:
        """The cost until now."""
        took = self.seconds
        return Cost(took, (time.process_time() - self._cpu) / took, self.memory, _resident_memory())

    def settle(self) -> None:
        """Count memory from now on."""
        self.memory = _resident_memory()


@contextmanager
def beside(serve: Callable[..., None], *arguments: object) -> Iterator[Connection]:
    """`serve` with `arguments` and a pipe in a process of its own; the other end of the pipe."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=serve, args=(*arguments, there), daemon=True)
    process.start()
    try:
        yield here
    finally:
        process.terminate()
        process.join()


def received(pipe: Connection) -> object:
    """What the process of devices says once they serve."""
    if not pipe.poll(60):
        raise RuntimeError("the simulated devices did not start within 60 s")
    return pipe.recv()


def _resident_memory() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6
