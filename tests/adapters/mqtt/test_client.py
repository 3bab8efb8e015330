"""The connection to a broker: what is left of it when nobody waits for it any more."""

from __future__ import annotations

import asyncio
import gc
import socket
import threading
from concurrent.futures import ThreadPoolExecutor

from support.waiting import PATIENCE

from adapters.mqtt.broker import BrokerConfig
from adapters.mqtt.client import connected


def test_a_connection_that_nobody_waits_for_any_more_is_closed() -> None:
    """The thread that connects goes on after its task has been cancelled."""
    begun = threading.Event()

    with socket.create_server(("127.0.0.1", 0)) as mute:
        port = mute.getsockname()[1]

        async def enter() -> None:
            async with connected(BrokerConfig(host="127.0.0.1", port=port, client_id="test", timeout=1.0)):
                raise AssertionError("a broker that says nothing is none")

        async def scenario() -> None:
            # The cancellation comes before the thread has been given a processor.
            loop = asyncio.get_running_loop()
            loop.set_default_executor(Late(begun))
            task = asyncio.create_task(enter())
            await asyncio.sleep(0.05)
            task.cancel()
            begun.set()
            await asyncio.gather(task, return_exceptions=True)

        gc.disable()
        try:
            asyncio.run(scenario())
            ours, _ = mute.accept()
            with ours:
                ours.settimeout(PATIENCE / 10)
                while ours.recv(1000):
                    pass
        finally:
            gc.enable()


class Late(ThreadPoolExecutor):
    """Threads that begin when they are allowed to."""

    def __init__(self, begun: threading.Event) -> None:
        super().__init__()
        self._begun = begun

    def submit(self, work, /, *arguments, **settings):  # type: ignore[no-untyped-def]
        def later():  # type: ignore[no-untyped-def]
            self._begun.wait()
            return work(*arguments, **settings)

        return super().submit(later)
