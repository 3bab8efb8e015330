"""The simulated BMS beside something else in the same process: the plant of the live demo."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress

from replay.bms.serving import BmsOptions, serve

_STOP_SECONDS = 5.0


@contextmanager
def living_bms(options: BmsOptions) -> Iterator[list[str]]:
    """Serve in a thread of its own while the block runs; gives what there is to say about it.

    Ports and files are there when the block begins. Raises what `serve` raises where the start fails.
    """
    begun: Future[list[str]] = Future()
    loop = asyncio.new_event_loop()
    stop = asyncio.Event()

    def live() -> None:
        try:
            with asyncio.Runner(loop_factory=lambda: loop) as runner:
                runner.run(serve(options, stop, begun.set_result))
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
        thread.join(_STOP_SECONDS)
