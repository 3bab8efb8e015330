"""Cancellation that does not get lost in a library."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from typing import TypeVar

Result = TypeVar("Result")


async def cancellable(work: Awaitable[Result]) -> Result:
    """What `work` of a library returns or raises, unless this task was cancelled meanwhile: then CancelledError.

    `asyncio.wait_for` of Python 3.11, with which the libraries wait, forgets a cancellation that comes together with
    the result. A source that is cancelled once, as all are when the daemon stops, would then read for ever.
    """
    task = asyncio.current_task()
    before = task.cancelling() if task is not None else 0
    try:
        return await work
    finally:
        if task is not None and task.cancelling() > before:
            raise asyncio.CancelledError
