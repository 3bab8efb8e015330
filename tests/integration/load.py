"""What the loads of all sources share: a process of devices beside the one that reads, and what reading costs it."""

from __future__ import annotations

import multiprocessing
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

SETTLING = 3.0
"""Seconds before the measurement begins, in which every connection is made and every buffer filled once."""
PATIENCE = 120.0
"""How much longer than asked for is measured, where no poll has come to its end, s."""
MOST_GROWTH = 5.0
"""MB that memory may grow by; the arrival times that are kept for the report are part of it."""


class Cost(NamedTuple):
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
