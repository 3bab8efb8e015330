"""Load of the BACnet source: many devices with many objects, each with a reading at a steady pace, by one event loop.

    python tests/integration/bacnet_load.py --seconds 600 [--polled]

The devices are bacpypes3's own, in a process of their own, and their values change all the time. Printed are polls made
and missed, readings, how late answers came at worst, the share of one processor that the reading process used, and its
resident memory at the beginning and at the end. `--polled` does without subscriptions.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from integration.load import PATIENCE, SETTLING, Meter, beside, received
from integration.modbus_load import Load
from support.bacnet_plant import Peer, free_udp_port
from support.sources import bound, source_table

from adapters.bacnet.source import BacnetSource


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


async def _follow(source: BacnetSource, arrivals: dict[str, list[float]], counts: list[int]) -> None:
    async for batch in source.batches(None):
        counts.append(sum(reading.fault is None for reading in batch.readings))
        arrivals.setdefault(batch.readings[0].channel.split("/")[0], []).append(asyncio.get_running_loop().time())


async def _measure(devices: int, objects: int, port: int, seconds: float, poll: float, cov: bool) -> Load:
    table = source_table("bacnet", interface="127.0.0.1/8", port=port, poll=poll, cov=cov)
    channels = [
        bound(table, f"d{device}/c{k}", unit="degC", device=1000 + device, object=f"analog-input,{k}")
        for device in range(devices)
        for k in range(1, objects + 1)
    ]
    source = table.build("bms", channels)
    arrivals: dict[str, list[float]] = {}
    counts: list[int] = []
    task = asyncio.create_task(_follow(source, arrivals, counts))
    await asyncio.sleep(2 * poll + SETTLING)
    arrivals.clear()
    counts.clear()
    late = source.late
    meter = Meter()
    await asyncio.sleep(seconds)
    # Of a few seconds on a busy machine, too, there is something to tell.
    while len(arrivals) < devices and meter.seconds < seconds + PATIENCE:
        await asyncio.sleep(poll)
    cost = meter.read()
    late = source.late - late
    task.cancel()
    (outcome,) = await asyncio.gather(task, return_exceptions=True)
    if not isinstance(outcome, asyncio.CancelledError):
        raise RuntimeError(f"the source failed: {outcome!r}")
    expected = int(cost.seconds / poll)
    gaps = [later - earlier for arrived in arrivals.values() for earlier, later in pairwise(arrived)]
    made = sum(map(len, arrivals.values()))
    return Load(
        devices=devices,
        channels=objects,
        polls=made,
        missed=sum(max(0, expected - len(arrivals.get(f"d{device}", ()))) for device in range(devices)) + late,
        readings=sum(counts),
        worst_gap=max(gaps, default=0.0) / poll,
        cost=cost,
    )


def measure(devices: int, objects: int, seconds: float, poll: float, cov: bool = True) -> Load:
    """Read `devices` devices with `objects` objects each for `seconds`."""
    port = free_udp_port()
    with beside(_serve, devices, objects, port) as pipe:
        received(pipe)
        return asyncio.run(_measure(devices, objects, port, seconds, poll, cov))


def main() -> int:
    """Measure as the arguments say; 1 if a reading was missed or memory has grown."""
    parser = argparse.ArgumentParser(description="load of the BACnet source")
    parser.add_argument("--devices", type=int, default=20)
    parser.add_argument("--objects", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--poll", type=float, default=10.0)
    parser.add_argument("--polled", action="store_true", help="without subscriptions")
    arguments = parser.parse_args()
    load = measure(arguments.devices, arguments.objects, arguments.seconds, arguments.poll, not arguments.polled)
    print("\n".join(load.lines()))
    lost = load.missed or load.readings != load.polls * load.channels
    return 1 if lost or load.cost.grew else 0


if __name__ == "__main__":
    sys.exit(main())
