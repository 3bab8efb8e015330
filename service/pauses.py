"""Pauses between attempts at what keeps failing."""

import asyncio


class GrowingPause:
    """`seconds` to wait before the next attempt: `first`, then twice as long each time, `longest` at most."""

    def __init__(self, first: float, longest: float) -> None:
        self.seconds = first
        self._first, self._longest = first, longest

    def grow(self) -> None:
        self.seconds = min(2 * self.seconds, self._longest)

    def reset(self) -> None:
        self.seconds = self._first


async def within(event: asyncio.Event, seconds: float) -> bool:
    """Whether `event` is set, or becomes so within `seconds`."""
    try:
        async with asyncio.timeout(seconds):
            return await event.wait()
    except TimeoutError:
        return False
