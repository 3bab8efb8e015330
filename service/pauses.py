"""Pauses between attempts at what keeps failing, and between sentences about it."""

from __future__ import annotations

import asyncio
import math
import time

REPEAT = 600.0
"""The same is said again after this time at the earliest, in s."""


class GrowingPause:
    """`seconds` to wait before the next attempt: `first`, then twice as long each time, `longest` at most."""

    def __init__(self, first: float, longest: float) -> None:
        self.seconds = first
        self._first, self._longest = first, longest

    def grow(self) -> None:
        """An attempt has failed."""
        self.seconds = min(2 * self.seconds, self._longest)

    def reset(self) -> None:
        """An attempt has succeeded."""
        self.seconds = self._first


async def within(event: asyncio.Event, seconds: float) -> bool:
    """Whether `event` is set, or becomes so within `seconds`."""
    try:
        async with asyncio.timeout(seconds):
            return await event.wait()
    except TimeoutError:
        return False


class Seldom:
    """Keeps the log from saying the same again and again."""

    def __init__(self) -> None:
        self._again: dict[str, float] = {}

    def due(self, what: str = "") -> bool:
        """Whether `what` may be said now, which is then not due for REPEAT s."""
        now = time.monotonic()
        due = now >= self._again.get(what, -math.inf)
        if due:
            self._again[what] = now + REPEAT
        return due
