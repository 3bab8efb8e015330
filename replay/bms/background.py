"""A simulated plant beside something else in the same process."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

Ready = TypeVar("Ready")


@contextmanager
def in_background(
    plant: Callable[[asyncio.Event, Callable[[Ready], None]], Coroutine[Any, Any, None]],
    patience: float = 5.0,
) -> Iterator[Ready]:
    """Run `plant(stop, ready)` in a thread of its own while the block runs; gives what it calls `ready` with.

    Ports and files are there when the block begins; after it, the plant has `patience` s to stop. Raises what `plant`
    raises where the start fails.
    """
    begun: Future[Ready] = Future()
    loop = asyncio.new_event_loop()
    stop = asyncio.Event()

    def live() -> None:
        try:
            with asyncio.Runner(loop_factory=lambda: loop) as runner:
                runner.run(plant(stop, begun.set_result))
        except BaseException as error:
            if begun.done():
                raise
            begun.set_exception(error)

    thread = threading.Thread(target=live, name="simulated-bms", daemon=True)
    thread.start()
    try:
        yield begun.result()
    finally:
        # The loop is closed already where serving has failed.
        with suppress(RuntimeError):
            loop.call_soon_threadsafe(stop.set)
        thread.join(patience)
