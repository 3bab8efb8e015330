"""Cancellation that does not get lost in a library."""

import asyncio
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any, TypeVar

Result = TypeVar("Result")


async def cancellable(work: Awaitable[Result]) -> Result:
    """What `work` of a library returns or raises; CancelledError if this task was cancelled meanwhile, which
    `asyncio.wait_for` of Python 3.11 forgets where the result comes at the same time."""
    task = asyncio.current_task()
    before = task.cancelling() if task is not None else 0
    try:
        return await work
    finally:
        if task is not None and task.cancelling() > before:
            raise asyncio.CancelledError


async def in_thread(work: Callable[[], Any], abandoned: Callable[[Any], object] | None = None) -> Any:
    """What `work` returns or raises, from a daemon thread; `abandoned` gets it where nobody waits any more."""
    loop = asyncio.get_running_loop()
    outcome: asyncio.Future[Any] = loop.create_future()

    def settle(result: Any, error: BaseException | None) -> None:
        if outcome.cancelled():
            if error is None and abandoned is not None:
                threading.Thread(target=abandoned, args=(result,), daemon=True).start()
        elif error is not None:
            outcome.set_exception(error)
        else:
            outcome.set_result(result)

    def run() -> None:
        result, error = None, None
        try:
            result = work()
        except BaseException as raised:
            error = raised
        # Nobody is left to tell once the loop is closed.
        with suppress(RuntimeError):
            loop.call_soon_threadsafe(settle, result, error)

    threading.Thread(target=run, name="library", daemon=True).start()
    return await outcome
