"""The connection to a broker: what is left of it when nobody waits for it any more."""

import asyncio
import socket

import pytest
from support.waiting import PATIENCE

from adapters.mqtt.broker import BrokerConfig
from adapters.mqtt.client import connected


@pytest.mark.parametrize("waited", [0.0, 0.05], ids=["while it connects", "while the broker says nothing"])
async def test_a_connection_that_nobody_waits_for_any_more_is_closed(waited: float) -> None:
    """The thread that connects goes on after its task has been cancelled."""

    async def enter(port: int) -> None:
        async with connected(BrokerConfig(host="127.0.0.1", port=port, client_id="test", timeout=1.0)):
            raise AssertionError("a broker that says nothing is none")

    with socket.create_server(("127.0.0.1", 0)) as mute:
        mute.settimeout(PATIENCE / 10)
        task = asyncio.create_task(enter(mute.getsockname()[1]))
        await asyncio.sleep(waited)
        if not waited:
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        ours, _ = await asyncio.to_thread(mute.accept)
        with ours:
            ours.settimeout(PATIENCE / 10)
            while await asyncio.to_thread(ours.recv, 1000):
                pass
