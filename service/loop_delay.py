"""How late the event loop is: the delay of a timer, over and over."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

PROBE_SECONDS = 0.01
"""From one timer to the next. What holds the loop for a time T shows as a delay from T - PROBE_SECONDS to T."""


async def watch_loop(observe: Callable[[float], None]) -> None:
    """Tell `observe` for ever how many s late the loop was for each timer."""
    loop = asyncio.get_running_loop()
    while True:
        due = loop.time() + PROBE_SECONDS
        await asyncio.sleep(PROBE_SECONDS)
        observe(max(0.0, loop.time() - due))
