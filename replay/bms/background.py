"""A simulated plant beside something else in the same process."""

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any, TypeVar

from adapters.background import Background

Ready = TypeVar("Ready")


@contextmanager
def in_background(
    plant: Callable[[asyncio.Event, Callable[[Ready], None]], Coroutine[Any, Any, None]],
    patience: float = 5.0,
) -> Iterator[Ready]:
    """Run `plant(stop, ready)` in a thread of its own while the block runs, from when it calls `ready`, whose argument
    the block gets; then it has `patience` s to stop. Raises what `plant` raises where the start fails."""
    begun: Future[Ready] = Future()
    stop, background = asyncio.Event(), Background("simulated-bms")

    async def live() -> None:
        try:
            await plant(stop, begun.set_result)
        except BaseException as error:
            if begun.done():
                raise
            begun.set_exception(error)

    background.start(live)
    try:
        yield begun.result()
    finally:
        background.call(stop.set)
        background.wait(patience)
