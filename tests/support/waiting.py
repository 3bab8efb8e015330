"""Waiting for what happens elsewhere, for as long as even a very busy machine needs."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

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


def wait_until(done: Callable[[], object]) -> None:
    """Wait in this thread until `done`; fails if that does not come."""
    deadline = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < deadline
        time.sleep(0.01)
