"""A Modbus server on loopback for tests: registers per table, faults on demand, and a record of what was asked."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerType
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from support import sites
from support.sources import bound, source_table
from support.waiting import PATIENCE

from replay.bms.background import in_background

READS = {1, 2, 3, 4}
"""The function codes that change nothing in a device."""

_BLOCKS = {1: "coil", 2: "discrete", 3: "holding", 4: "input"}


def channel(name: str, register: int, type: str = "int16", **keys: Any) -> dict[str, Any]:
    """Channel `name` of the zone z in a register that counts from 0."""
    return {"id": f"z/{name}", "register": register, "type": type} | keys


def source(port: int, channels: Sequence[Mapping[str, Any]], **keys: Any) -> Any:
    """A source of `channels` at `port` of this machine that polls all the time, for a table with `keys`."""
    quick = {"host": "127.0.0.1", "port": port, "first_register": 0, "timeout": 2.0, "retries": 0, "poll": 0.05}
    table = source_table("modbus", **quick | keys)
    return table.build("bms", [bound(table, **one) for one in channels])


@dataclass
class Plant:
    """What the units hold and how they behave; changes take effect with the next request."""

    registers: dict[tuple[int, str], list[int]]
    """(unit, table) to its words from address 0 on; of bits, the registers that hold them, bit 0 first."""
    refused: set[tuple[int, str, int]] = field(default_factory=set)
    """(unit, table, address) that are answered with exception 2."""
    silent: set[int] = field(default_factory=set)
    exceptions: dict[int, ExcCodes] = field(default_factory=dict)
    """Unit to the exception that it answers everything with."""
    failing: dict[tuple[int, str, int], ExcCodes] = field(default_factory=dict)
    """(unit, table, address) to the exception that it is answered with."""
    asked: list[tuple[int, int, int, int]] = field(default_factory=list)
    """(unit, function code, address, count) of every request."""
    codes: set[int] = field(default_factory=set)
    """Function codes of every frame that came over TCP, those among them that the server does not know."""
    connections: int = 0
    port: int = 0
    server: ModbusTcpServer | None = None

    def requests(self, unit: int | None = None) -> list[tuple[int, int]]:
        """(address, count) of what a unit was asked."""
        return [(address, count) for who, _, address, count in self.asked if unit in (None, who)]

    def drop(self) -> None:
        """Close every connection that there is."""
        for connection in list(self.server.active_connections.values()):
            connection.transport.abort()


def plant(words: Mapping[int, list[int]] | None = None, **tables: list[int]) -> Plant:
    """A plant of units with holding `words`, or of one unit with `tables`."""
    if words is not None:
        return Plant({(unit, "holding"): list(values) for unit, values in words.items()})
    return Plant({(1, table): list(values) for table, values in tables.items()})


@asynccontextmanager
async def serving(plant: Plant, framer: FramerType = FramerType.SOCKET, port: int = 0) -> AsyncIterator[Plant]:
    """Serve `plant` on a free port of 127.0.0.1, or on `port`."""

    def connected(here: bool) -> None:
        plant.connections += here

    def trace(sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending:
            plant.asked.append((pdu.dev_id, pdu.function_code, pdu.address, pdu.count))
        return pdu

    def raw(sending: bool, data: bytes) -> bytes:
        if not sending and framer is FramerType.SOCKET and len(data) > 7:
            plant.codes.add(data[7])
        return data

    server = ModbusTcpServer(
        [_device(plant, unit) for unit in sorted({unit for unit, _ in plant.registers})],
        framer=framer,
        address=("127.0.0.1", port),
        trace_packet=raw,
        trace_pdu=trace,
        trace_connect=connected,
    )
    await server.serve_forever(background=True)
    plant.server, plant.port = server, server.transport.sockets[0].getsockname()[1]
    try:
        yield plant
    finally:
        await shut_down(server)
    assert {code for _, code, _, _ in plant.asked} | plant.codes <= READS, "a source of telemetry only reads, ever"


async def shut_down(server: ModbusTcpServer) -> None:
    """Close the port of `server` and every connection.

    asyncio loses the socket of a connection that it has accepted for a server which is closed before it gets to it, and
    pymodbus that of one which has not come about: so the port stops accepting a few passes of the loop before.
    """
    loop = asyncio.get_running_loop()
    for listening in server.transport.sockets:  # type: ignore[attr-defined]
        loop.remove_reader(listening)
    for _ in range(4):
        await asyncio.sleep(0)
    await server.shutdown()
    await asyncio.sleep(0)


def _device(plant: Plant, unit: int) -> SimDevice:
    async def act(
        code: int, start: int, address: int, count: int, current: list[int], values: list[int] | list[bool] | None
    ) -> ExcCodes | None:
        if unit in plant.silent:
            await asyncio.sleep(3600)
        if unit in plant.exceptions:
            return plant.exceptions[unit]
        table = _BLOCKS.get(code, "")
        if any((unit, table, address + k) in plant.refused for k in range(count)):
            return ExcCodes.ILLEGAL_ADDRESS
        for k in range(count):
            if (unit, table, address + k) in plant.failing:
                return plant.failing[unit, table, address + k]
        words = plant.registers.get((unit, table), [])
        current[: len(words)] = words
        return None

    coils, discretes, holdings, inputs = (
        [SimData(0, values=list(plant.registers.get((unit, table), [0])), datatype=kind)]
        for table, kind in (
            ("coil", DataType.BITS),
            ("discrete", DataType.BITS),
            ("holding", DataType.REGISTERS),
            ("input", DataType.REGISTERS),
        )
    )
    return SimDevice(unit, simdata=(coils, discretes, holdings, inputs), action=act)


@contextmanager
def running(site: Plant, port: int = 0) -> Iterator[Plant]:
    """`site` served by a thread of its own."""

    async def served(stop: asyncio.Event, ready: Callable[[Plant], None]) -> None:
        async with serving(site, port=port):
            ready(site)
            await stop.wait()

    with in_background(served, PATIENCE) as plant:
        yield plant


WORDS = [215, 53, 400, 21]
"""Tenths of the room and of the outdoor temperature, W, and another room."""


def configuration(folder: Path, ports: Mapping[str, int]) -> Path:
    """A daemon's, with a zone for the device at each of `ports`, which holds WORDS."""
    quick = {"kind": "modbus", "host": "127.0.0.1", "poll": 0.2, "timeout": 30.0, "retries": 0, "fill_gaps": 0}
    tenths = {"type": "int16", "scale": 0.1}
    places = {
        "T_i": {"register": 0, **tenths},
        "T_out": {"register": 1, **tenths},
        "u_heat": {"register": 2, "type": "uint16"},
    }
    return sites.written(
        folder,
        {name: quick | {"port": port, "first_register": 0} for name, port in ports.items()},
        [sites.zone(f"zone-{name}", name, places, hold_inputs="20s", max_gap=40) for name in ports],
    )
