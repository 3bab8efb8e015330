"""The pace of a recording: a multiple of real time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import isfinite

_LONGEST_SLEEP = 0.5
"""How long a paced source may sleep without looking whether it was closed, in s."""


class Pacer:
    """Keeps source time at `pace` times real time, counted from the first row so that sleeping adds no drift."""

    def __init__(self, pace: float | None) -> None:
        """`pace` None: as fast as possible."""
        self._pace = pace
        self._origin: tuple[float, float] | None = None

    async def wait(self, time: float, closed: Callable[[], bool]) -> None:
        """Wait until source time `time` (UTC s) is due, or the source is `closed`; give the event loop its turn."""
        # Even a source in a hurry does.
        await asyncio.sleep(0)
        while not closed() and (delay := self._delay(time)) > 0:
            await asyncio.sleep(min(delay, _LONGEST_SLEEP))

    def _delay(self, time: float) -> float:
        """Seconds until source time `time` is due; 0 or less if it is already."""
        if self._pace is None or not isfinite(time):
            return 0.0
        real = asyncio.get_running_loop().time()
        if self._origin is None:
            self._origin = (real, time)
        real_origin, source_origin = self._origin
        return real_origin + (time - source_origin) / self._pace - real
