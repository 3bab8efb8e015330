"""Load of the Modbus source: many devices with many registers, polled at a steady pace by one event loop.

    python tests/integration/modbus_load.py --seconds 600

The devices live in a process of their own. Printed are polls made and missed, how late answers came at worst, the share
of one processor that the polling process used, and its resident memory at the beginning and at the end.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from integration.load import PATIENCE, SETTLING, Cost, Meter, beside, received
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from support.modbus_plant import channel, source

from adapters.reading import Source


class Load(NamedTuple):
    """What was measured."""

    devices: int
    channels: int
    polls: int
    missed: int
    """Polls that should have been made and were not."""
    readings: int
    worst_gap: float
    """Longest time between two answers of a device, in polls."""
    cost: Cost

    def lines(self) -> list[str]:
        """For a person."""
        return [
            f"{self.devices} devices x {self.channels} points for {self.cost.seconds:.0f} s",
            f"polls {self.polls}, missed {self.missed}, readings {self.readings}, worst gap {self.worst_gap:.2f} polls",
            *self.cost.lines(),
        ]


def _serve(devices: int, registers: int, pipe: Connection) -> None:
    """Serve every device on a port of its own until the process is ended; the ports go through `pipe`."""

    async def serve() -> None:
        ports = []
        for device in range(devices):
            words = [200 + (7 * device + k) % 50 for k in range(registers)]
            simulated = SimDevice(1, simdata=[SimData(0, values=words, datatype=DataType.REGISTERS)])
            server = ModbusTcpServer(simulated, address=("127.0.0.1", 0))
            await server.serve_forever(background=True)
            ports.append(server.transport.sockets[0].getsockname()[1])
        pipe.send(ports)
        await asyncio.Event().wait()

    asyncio.run(serve())


async def _poll(device: Source, arrivals: list[float], counts: list[int]) -> None:
    async for batch in device.batches(None):
        arrivals.append(asyncio.get_running_loop().time())
        counts.append(len(batch.readings))


async def _measure(ports: list[int], registers: int, seconds: float, poll: float) -> Load:
    channels = [channel(f"c{k}", k, scale=0.1, unit="degC") for k in range(registers)]
    sources = [source(port, channels, timeout=3.0, retries=1, poll=poll) for port in ports]
    arrivals: list[list[float]] = [[] for _ in ports]
    counts: list[list[int]] = [[] for _ in ports]
    tasks = [
        asyncio.create_task(_poll(device, arrived, counted))
        for device, arrived, counted in zip(sources, arrivals, counts, strict=True)
    ]
    await asyncio.sleep(SETTLING)
    for kept in (*arrivals, *counts):
        kept.clear()
    meter = Meter()
    await asyncio.sleep(seconds)
    # Of a few seconds on a busy machine, too, there is something to tell.
    while not all(arrivals) and meter.seconds < seconds + PATIENCE:
        await asyncio.sleep(poll)
    cost = meter.read()
    for task in tasks:
        task.cancel()
    outcomes = await asyncio.gather(*tasks, return_exceptions=True)
    failures = [outcome for outcome in outcomes if not isinstance(outcome, asyncio.CancelledError)]
    if failures:
        raise RuntimeError(f"{len(failures)} of {len(tasks)} sources failed: {failures[0]!r}")
    expected = int(cost.seconds / poll)
    gaps = [later - earlier for arrived in arrivals for earlier, later in pairwise(arrived)]
    return Load(
        devices=len(ports),
        channels=registers,
        polls=sum(map(len, arrivals)),
        missed=sum(max(0, expected - len(arrived)) for arrived in arrivals) + sum(device.late for device in sources),
        readings=sum(map(sum, counts)),
        worst_gap=max(gaps, default=0.0) / poll,
        cost=cost,
    )


def measure(devices: int, registers: int, seconds: float, poll: float = 1.0) -> Load:
    """Poll `devices` devices with `registers` registers each every `poll` s for `seconds`."""
    with beside(_serve, devices, registers) as pipe:
        ports = received(pipe)
        assert isinstance(ports, list)
        return asyncio.run(_measure(ports, registers, seconds, poll))


def main() -> int:
    """Measure as the arguments say; 1 if a poll was missed or memory has grown."""
    parser = argparse.ArgumentParser(description="load of the Modbus source")
    parser.add_argument("--devices", type=int, default=50)
    parser.add_argument("--registers", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--poll", type=float, default=1.0)
    arguments = parser.parse_args()
    load = measure(arguments.devices, arguments.registers, arguments.seconds, arguments.poll)
    print("\n".join(load.lines()))
    return 1 if load.missed or load.cost.grew else 0


if __name__ == "__main__":
    sys.exit(main())
