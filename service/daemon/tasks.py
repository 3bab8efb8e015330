"""Tasks of the event loop, and how they end."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import Any, TypeVar

Result = TypeVar("Result")

_AGAIN_SECONDS = 0.5
"""How long a cancelled task may take to clean up before it is cancelled again, in s."""


async def end(tasks: Collection[asyncio.Future[Any]]) -> None:
    """Cancel `tasks` and wait until they are over, whatever comes of them.

    One cancellation may not be enough: `asyncio.wait_for` of Python 3.11, in which the Modbus library waits for its
    answers, passes over one that meets an answer.
    """
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


async def abandonable(function: Callable[[], Result]) -> Result:
    """What `function` returns on a thread that the process does not wait for at its end: a file that it reads may be a
    pipe that nobody writes to."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[Result] = loop.create_future()

    def settle(outcome: Callable[[], None]) -> None:
        # The loop may have ended meanwhile.
        with suppress(RuntimeError):
            loop.call_soon_threadsafe(lambda: None if done.done() else outcome())

    def work() -> None:
        try:
            result = function()
        except BaseException as error:
            failure = error
            settle(lambda: done.set_exception(failure))
        else:
            settle(lambda: done.set_result(result))

    threading.Thread(target=work, name="abandonable", daemon=True).start()
    return await done
