"""Load of the BACnet source: many devices with many objects, each with a reading at a steady pace, by one event loop.

    python tests/integration/bacnet_load.py --seconds 600 [--polled]

The devices are bacpypes3's own, in a process of their own, and their values change all the time. Printed are polls made
and missed, readings, how late answers came at worst, the share of one processor that the reading process used, and its
resident memory at the beginning and at the end. `--polled` does without subscriptions.
"""

from __future__ import annotations

import asyncio
import sys
from multiprocessing.connection import Connection
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from integration import load
from integration.command import command
from integration.load import Polled, beside, received
from support.bacnet_plant import Peer, free_udp_port
from support.sources import bound, source_table


def _serve(devices: int, objects: int, port: int, pipe: Connection) -> None:
    """Serve every device until the process is ended."""

    async def serve() -> None:
        peers = [Peer(1000 + device, port, 1 + device) for device in range(devices)]
        made = [[peer.add(f"analog-input,{k}", 20.0 + k / 10) for k in range(1, objects + 1)] for peer in peers]
        for peer in peers:
            await peer.server.ready()
        pipe.send(True)
        turn = 0
        while True:
            # Every second a tenth of the values changes by more than their COV increment.
            turn += 1
            for inputs in made:
                for one in inputs[turn % 10 :: 10]:
                    one.presentValue = 20.0 + turn % 7
            await asyncio.sleep(1.0)

    asyncio.run(serve())


def measure(devices: int, objects: int, seconds: float, poll: float, polled: bool = False) -> Polled:
    """Read `devices` devices with `objects` objects each for `seconds`; without subscriptions if they are `polled`."""
    port = free_udp_port()

    async def read() -> Polled:
        table = source_table("bacnet", interface="127.0.0.1/8", port=port, poll=poll, cov=not polled)
        channels = [
            bound(table, f"d{device}/c{k}", unit="degC", device=1000 + device, object=f"analog-input,{k}")
            for device in range(devices)
            for k in range(1, objects + 1)
        ]
        return await load.polled([table.build("bms", channels)], devices, objects, seconds, poll)

    with beside(_serve, devices, objects, port) as pipe:
        received(pipe)
        return asyncio.run(read())


if __name__ == "__main__":
    about = "load of the BACnet source"
    sys.exit(command(about, measure, devices=20, objects=50, seconds=600.0, poll=10.0, polled=False))
