"""Tasks of the event loop, and how they end."""

import asyncio
from collections.abc import Collection
from typing import Any

_AGAIN_SECONDS = 0.5
"""How long a cancelled task may take to clean up before it is cancelled again, in s."""


async def end(tasks: Collection[asyncio.Future[Any]]) -> None:
    """Cancel `tasks` and wait until they are over, whatever comes of them. One cancellation may not be enough:
    `asyncio.wait_for` of Python 3.11, in which the Modbus library waits for its answers, passes over one that meets an
    answer."""
    pending = set(tasks)
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=_AGAIN_SECONDS)
    await asyncio.gather(*tasks, return_exceptions=True)


async def done_before(stop: asyncio.Future[Any], work: asyncio.Future[Any]) -> bool:
    """Whether `work` was done before `stop`; if not, it is ended. Its failure is raised."""
    await asyncio.wait([stop, work], return_when=asyncio.FIRST_COMPLETED)
    if not work.done():
        await end([work])
        return False
    work.result()
    return True
