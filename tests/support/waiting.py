"""Waiting for what happens elsewhere, for as long as even a very busy machine needs."""

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Found = TypeVar("Found")

PATIENCE = 180.0
"""After so many s what is waited for does not come any more."""


async def until(done: Callable[[], object]) -> None:
    """Let the event loop turn until `done`; TimeoutError if that does not come."""
    async with asyncio.timeout(PATIENCE):
        while not done():
            await asyncio.sleep(0.01)


def between(begin: float, moment: float | None, end: float) -> bool:
    """Whether a moment lies between two others, UTC s; times on the wire are cut to less than a millisecond."""
    return moment is not None and begin - 0.001 <= moment <= end + 0.001


def wait_until(
    done: Callable[[], Found], told: Callable[[], object] = lambda: "", patience: float = PATIENCE, pause: float = 0.05
) -> Found:
    """What `done` returns, once that is true, asked every `pause` s; fails with what is `told` if it never is."""
    deadline = time.monotonic() + patience
    while not (found := done()):
        assert time.monotonic() < deadline, told()
        time.sleep(pause)
    return found


@contextmanager
def turns_beside() -> Iterator[Callable[[], int]]:
    """How often the event loop has turned beside what is done in the context."""
    turns = 0

    async def other() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    beside = asyncio.create_task(other())
    try:
        yield lambda: turns
    finally:
        beside.cancel()


@contextmanager
def repeated(act: Callable[[], object], seconds: float = 0.2) -> Iterator[None]:
    """Do `act` over and over on a thread of its own, as long as the context lasts."""
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(seconds):
            act()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
