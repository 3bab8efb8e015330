"""The plant's Modbus TCP server: pymodbus' own, with values encoded when they are asked for, and the menu's faults.

All devices are behind one address, told apart by their unit ids, as behind a gateway. Reading is all there is: any
other function is refused.
"""

from __future__ import annotations

import asyncio
import logging
from functools import partial

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from replay.bms.plant import Device
from replay.bms.registers import BIT_TABLES, Register, encode
from replay.bms.simulation import Simulation
from replay.errors import ReplayError

_READS = {1: "coil", 2: "discrete", 3: "holding", 4: "input"}
_BITS_PER_WORD = 16
_ACCEPTING = 4
"""After so many passes of the event loop a connection that was being accepted has come about."""


class ModbusServer:
    """The server on a loopback port; `port` is the one in use, also when it was asked for as 0."""

    def __init__(self, server: _Server) -> None:
        self._server = server
        self.port: int = server.transport.sockets[0].getsockname()[1]  # type: ignore[attr-defined]

    @classmethod
    async def start(cls, simulation: Simulation, port: int) -> ModbusServer:
        """Listen on 127.0.0.1; ReplayError if the port cannot be had."""
        # pymodbus reports what the faults provoke, connections closed and the like, as errors of its own.
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        server = _Server(simulation, port)
        try:
            await server.serve_forever(background=True)
        except RuntimeError:
            raise ReplayError(
                f"--port {port}: 127.0.0.1:{port} cannot be used, perhaps another process has it; choose another port, "
                "or 0 for any free one"
            ) from None
        return cls(server)

    async def stop(self) -> None:
        """Close the port and every connection."""
        await shut_down(self._server)


async def shut_down(server: ModbusTcpServer) -> None:
    """Close the port of `server` and every connection.

    asyncio loses the socket of a connection that it has accepted for a server which is closed before it gets to it, and
    pymodbus that of one which has not come about: so the port stops accepting first.
    """
    loop = asyncio.get_running_loop()
    for listening in server.transport.sockets:  # type: ignore[attr-defined]
        loop.remove_reader(listening)
    for _ in range(_ACCEPTING):
        await asyncio.sleep(0)
    await server.shutdown()
    await asyncio.sleep(0)


class _Server(ModbusTcpServer):
    """pymodbus' server with connections of our own making."""

    def __init__(self, simulation: Simulation, port: int) -> None:
        devices = [_sim_device(device, simulation) for device in simulation.plant]
        super().__init__(devices, address=("127.0.0.1", port))
        self.simulation = simulation
        self.unit_ids = {device.unit_id: device for device in simulation.plant}

    def callback_new_connection(self) -> ServerRequestHandler:
        return _Connection(self, None, None, None)


class _Connection(ServerRequestHandler):
    """One client. Requests are answered in their order and one at a time, each under its own transaction id.

    pymodbus would label a late answer with the id of the newest request, which no device does.
    """

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)
        self._turn = asyncio.Lock()
        self._answers: set[asyncio.Task[None]] = set()

    def handle_later(self) -> None:
        if self.last_pdu is not None:
            answer = self.loop.create_task(self._answer(self.last_pdu))
            self._answers.add(answer)
            answer.add_done_callback(self._answers.discard)

    def callback_disconnected(self, exc: Exception | None) -> None:
        for answer in self._answers:
            answer.cancel()
        super().callback_disconnected(exc)

    async def _answer(self, request: ModbusPDU) -> None:
        async with self._turn:
            response = await self._response(request)
        if response is not None and self.transport is not None:
            response.transaction_id, response.dev_id = request.transaction_id, request.dev_id
            self.server_send(response, None)

    async def _response(self, request: ModbusPDU) -> ModbusPDU | None:
        """The answer, an exception among them; None where there is none."""
        function = request.function_code
        device = self.server.unit_ids.get(request.dev_id)
        if device is None:
            return ExceptionResponse(function, ExcCodes.GATEWAY_NO_RESPONSE)
        faults = self.server.simulation.faults
        read = _channels_read(device, request)
        for channel in read:
            if faults.active("drop", device.name, channel):
                self.close()
                return None
            if faults.active("silent", device.name, channel):
                return None
        delays = [fault.value for channel in read if (fault := faults.active("slow", device.name, channel))]
        if delays:
            await asyncio.sleep(max(delays))
        for channel in read:
            if fault := faults.active("exception", device.name, channel):
                return ExceptionResponse(function, round(fault.value))
        if function not in _READS:
            return ExceptionResponse(function, ExcCodes.ILLEGAL_FUNCTION)
        response: ModbusPDU = await request.datastore_update(self.server.context, request.dev_id)
        return response


def _channels_read(device: Device, request: ModbusPDU) -> list[str | None]:
    """The channels that `request` reads a part of, and None for the device as a whole."""
    table = _READS.get(request.function_code)
    if table is None:
        return [None]
    place = (table, request.address, request.count)
    return [None, *(channel.name for channel in device.channels if channel.register.overlaps(*place))]


def _sim_device(device: Device, simulation: Simulation) -> SimDevice:
    coils, discretes, holdings, inputs = (
        [
            SimData(channel.register.address, count=channel.register.words, datatype=_datatype(channel.register))
            for channel in device.channels
            if channel.register.table == table
        ]
        or [_unused(table)]
        for table in ("coil", "discrete", "holding", "input")
    )
    return SimDevice(device.unit_id, (coils, discretes, holdings, inputs), action=partial(_refresh, device, simulation))


def _datatype(register: Register) -> DataType:
    return DataType.BITS if register.type == "bool" else DataType.REGISTERS


def _unused(table: str) -> SimData:
    """What pymodbus needs in a table that a device does not have."""
    if table in BIT_TABLES:
        return SimData(0xFFF0, count=_BITS_PER_WORD, values=False, datatype=DataType.BITS)
    return SimData(0xFFFF, datatype=DataType.INVALID)


async def _refresh(
    device: Device,
    simulation: Simulation,
    function: int,
    first: int,
    address: int,
    count: int,
    registers: list[int],
    _written: list[int] | list[bool] | None,
) -> ExcCodes | None:
    """pymodbus' action: write the present values of what is to be read into `registers`, which begin at `first`."""
    table = _READS[function]
    if table in BIT_TABLES:
        # `count` and the places in `registers` are words of sixteen bits, `address` is a bit.
        address, count = address // _BITS_PER_WORD * _BITS_PER_WORD, count * _BITS_PER_WORD
    for channel in device.channels:
        if not channel.register.overlaps(table, address, count):
            continue
        swapped = simulation.faults.active("swapped-words", device.name, channel.name) is not None
        words = encode(channel.register, simulation.value(device, channel), swapped=swapped)
        if table in BIT_TABLES:
            place, bit = divmod(channel.register.address, _BITS_PER_WORD)
            registers[place - first] = registers[place - first] & ~(1 << bit) | words[0] << bit
        else:
            start = channel.register.address - first
            registers[start : start + len(words)] = words
    return None
