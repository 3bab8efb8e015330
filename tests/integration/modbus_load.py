"""Load of the Modbus source: many devices with many registers, polled at a steady pace by one event loop.

    python tests/integration/modbus_load.py --seconds 600

The devices live in a process of their own. Printed are polls made and missed, how late answers came at worst, the share
of one processor that the polling process used, and its resident memory at the beginning and at the end.
"""

from __future__ import annotations

import asyncio
import sys
from multiprocessing.connection import Connection
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from integration.command import command
from integration.load import Polled, beside, polled, received
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from support.modbus_plant import channel, source


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


def measure(devices: int, registers: int, seconds: float, poll: float = 1.0) -> Polled:
    """Poll `devices` devices with `registers` registers each every `poll` s for `seconds`."""

    async def read() -> Polled:
        sources = []
        for device, port in enumerate(ports):
            channels = [channel("", k, id=f"d{device}/c{k}", scale=0.1, unit="degC") for k in range(registers)]
            sources.append(source(port, channels, timeout=3.0, retries=1, poll=poll))
        return await polled(sources, devices, registers, seconds, poll)

    with beside(_serve, devices, registers) as pipe:
        ports = received(pipe)
        assert isinstance(ports, list)
        return asyncio.run(read())


if __name__ == "__main__":
    sys.exit(command("load of the Modbus source", measure, devices=50, registers=100, seconds=600.0, poll=1.0))
