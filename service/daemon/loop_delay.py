"""How late the event loop is: the delay of a timer, over and over."""

import asyncio
from collections.abc import Callable

PROBE_SECONDS = 0.01
"""From one timer to the next while the loop is busy, s: a delay shows too short by so much at most."""
IDLE_SECONDS = 0.05
"""The same while it is idle: ten thousand timers in 100 s would cost an idle daemon 1 % of a core."""
_BUSY = 0.002
"""Delay in s from which the loop counts as busy."""


async def watch_loop(observe: Callable[[float], None]) -> None:
    """Tell `observe` for ever how many s late the loop was for each timer."""
    loop = asyncio.get_running_loop()
    pause = PROBE_SECONDS
    while True:
        due = loop.time() + pause
        await asyncio.sleep(pause)
        delay = max(0.0, loop.time() - due)
        observe(delay)
        pause = PROBE_SECONDS if delay > _BUSY else min(2 * pause, IDLE_SECONDS)
