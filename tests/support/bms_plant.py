"""A simulated plant with a clock of one's own, its servers, and clients to look at it from outside."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import httpx
from pymodbus.client import AsyncModbusTcpClient

from replay.bms.control import create_control
from replay.bms.modbus_server import ModbusServer
from replay.bms.simulation import Simulation


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def simulation(clock: Callable[[], float], **changes: Any) -> Simulation:
    return Simulation(**({"zones": 3, "seed": 1, "pace": 60.0, "clock": clock} | changes))


def started() -> tuple[Clock, Simulation]:
    """A plant, and the clock that it goes by."""
    clock = Clock()
    return clock, simulation(clock)


@asynccontextmanager
async def served(plant: Simulation) -> AsyncIterator[AsyncModbusTcpClient]:
    """A pymodbus client connected to a server of `plant`."""
    server = await ModbusServer.start(plant, 0)
    client = AsyncModbusTcpClient("127.0.0.1", port=server.port, timeout=2, retries=0)
    try:
        assert await client.connect()
        yield client
    finally:
        client.close()
        await server.stop()


async def room2(client: AsyncModbusTcpClient) -> float:
    """The air of room 2, decoded by pymodbus."""
    words = (await client.read_holding_registers(100, count=2, device_id=12)).registers
    value = client.convert_from_registers(words, client.DATATYPE.FLOAT32, word_order="little")
    assert isinstance(value, float)
    return value


async def room1(client: AsyncModbusTcpClient) -> float:
    """The air of room 1."""
    word = (await client.read_input_registers(0, device_id=11)).registers[0]
    return (word - 0x10000 if word >= 0x8000 else word) / 10


Look = Callable[[AsyncModbusTcpClient, Simulation, Clock], Awaitable[None]]


def ask(plant: Simulation, *requests: tuple[str, str, Any]) -> list[httpx.Response]:
    """The responses to (method, path, JSON body) in their order."""

    async def main() -> list[httpx.Response]:
        transport = httpx.ASGITransport(create_control(plant))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return [await client.request(method, path, json=body) for method, path, body in requests]

    return asyncio.run(main())
