"""The plant's Modbus TCP server: values are encoded when they are asked for, and the menu's faults act. All devices are
behind one address, told apart by their unit ids; any function but reading is refused."""

from __future__ import annotations

import asyncio
import struct
from contextlib import closing, suppress

from adapters.modbus.client import FUNCTION_CODES
from adapters.modbus.codec import BIT_TABLES, BITS_AT_MOST, REGISTERS_AT_MOST
from replay.bms.plant import Device
from replay.bms.registers import encode
from replay.bms.simulation import Simulation
from replay.errors import ReplayError

_HEADER = struct.Struct(">HHHB")
"""Transaction, protocol, octets from here on, unit id (Modbus messaging on TCP/IP 1.0b, 3.1.3)."""

_ILLEGAL_FUNCTION, _ILLEGAL_ADDRESS, _ILLEGAL_VALUE, _GATEWAY_NO_RESPONSE = 1, 2, 3, 11
_TABLES = {code: table for table, code in FUNCTION_CODES.items()}


class ModbusServer:
    """The server on a loopback port; `port` is the one in use, also when it was asked for as 0."""

    def __init__(self, simulation: Simulation) -> None:
        self.port = 0
        self._server: asyncio.Server | None = None
        self._simulation = simulation
        self._devices = {device.unit_id: device for device in simulation.plant}
        self._connections: set[asyncio.Task[None]] = set()

    @classmethod
    async def start(cls, simulation: Simulation, port: int) -> ModbusServer:
        """Listen on 127.0.0.1; ReplayError if the port cannot be had."""
        started = cls(simulation)
        try:
            started._server = server = await asyncio.start_server(started._connected, "127.0.0.1", port)
        except OSError:
            raise ReplayError(
                f"--port {port}: 127.0.0.1:{port} cannot be used, perhaps another process has it; choose another port, "
                "or 0 for any free one"
            ) from None
        started.port = server.sockets[0].getsockname()[1]
        return started

    async def stop(self) -> None:
        if self._server is not None:
            self._server.close()
        for connection in self._connections:
            connection.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)

    def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = asyncio.create_task(self._attend(reader, writer))
        self._connections.add(connection)
        connection.add_done_callback(self._connections.discard)

    async def _attend(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One client: its requests are answered in their order and one at a time."""
        with closing(writer), suppress(ConnectionError, asyncio.IncompleteReadError):
            while True:
                transaction, protocol, length, unit = _HEADER.unpack(await reader.readexactly(_HEADER.size))
                if length < 2:
                    return
                answer = await self._answer(unit, await reader.readexactly(length - 1))
                if answer is not None:
                    writer.write(_HEADER.pack(transaction, protocol, 1 + len(answer), unit) + answer)
                    await writer.drain()

    async def _answer(self, unit: int, request: bytes) -> bytes | None:
        """The answer, an exception among them; None where there is none. ConnectionError closes the connection."""
        function, device = request[0], self._devices.get(unit)
        if device is None:
            return _refusal(function, _GATEWAY_NO_RESPONSE)
        table, faults = _TABLES.get(function, ""), self._simulation.faults
        address, count = struct.unpack(">HH", request[1:5]) if table and len(request) == 5 else (0, 0)
        read = [one.name for one in device.channels if one.register.overlaps(table, address, count)]
        if faults.on_request("drop", device.name, read):
            raise ConnectionAbortedError
        if faults.on_request("silent", device.name, read):
            return None
        await asyncio.sleep(max((slow.value for slow in faults.on_request("slow", device.name, read)), default=0.0))
        for exception in faults.on_request("exception", device.name, read):
            return _refusal(function, round(exception.value))
        if not table:
            return _refusal(function, _ILLEGAL_FUNCTION)
        if not 0 < count <= (BITS_AT_MOST if table in BIT_TABLES else REGISTERS_AT_MOST):
            return _refusal(function, _ILLEGAL_VALUE)
        there = self._words(device, table, address, count)
        if any(place not in there for place in range(address, address + count)):
            return _refusal(function, _ILLEGAL_ADDRESS)
        words = [there[place] for place in range(address, address + count)]
        if table in BIT_TABLES:
            content = sum(bit << place for place, bit in enumerate(words)).to_bytes((count + 7) // 8, "little")
        else:
            content = struct.pack(f">{count}H", *words)
        return bytes([function, len(content)]) + content

    def _words(self, device: Device, table: str, address: int, count: int) -> dict[int, int]:
        """Registers or bits by their address: the present values of whatever is read a part of."""
        words: dict[int, int] = {}
        for channel in device.channels:
            if channel.register.overlaps(table, address, count):
                swapped = self._simulation.faults.active("swapped-words", device.name, channel.name) is not None
                encoded = encode(channel.register, self._simulation.value(device, channel), swapped=swapped)
                words |= dict(enumerate(encoded, channel.register.address))
        return words


def _refusal(function: int, code: int) -> bytes:
    return bytes([function | 0x80, code])
