"""The connection to a Modbus device or gateway: pymodbus behind a few verbs, its errors as ours. It can only read."""

import asyncio
import logging
import struct
import termios
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, NamedTuple

from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.client.base import ModbusBaseClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerType
from pymodbus.pdu import ModbusPDU

from adapters.cancelling import cancellable
from adapters.errors import SourceUnavailable
from adapters.modbus.config import ModbusConfig

EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledge",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not respond",
}
"""What exception codes mean (Modbus application protocol 1.1b3, 7)."""

FUNCTION_CODES = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}

READS = frozenset(FUNCTION_CODES.values())
"""The function codes that are ever sent: coils, discrete inputs, holding registers, input registers."""

_LASTING = {1, 2, 3}
"""Codes that say that there is no such thing in the device, whenever it is asked."""

_ABOUT_THE_UNIT = {5, 6, 10, 11}
"""Codes that say that the unit cannot answer now, whatever it is asked."""

# A silent unit behind a gateway is no reason to drop the connection; the source decides that.
_NEVER = 1 << 30

# What the library says in its log, the errors here say in the operator's words.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


class NoAnswer(Exception):
    """The unit did not answer, or cannot answer now; the connection may be sound."""


class _Nonsense(ModbusException):
    """What came is no answer that the protocol has."""


class Refused(Exception):
    """The device has no such registers, or does not give them; `lasting`: it will answer so again."""

    def __init__(self, reason: str, lasting: bool) -> None:
        super().__init__(reason)
        self.lasting = lasting


class Answer(NamedTuple):
    """Registers (0 to 65535) or bits (0 and 1), and the UTC s when they arrived."""

    words: list[int]
    time: float


class ModbusLink:
    """One connection; requests go out one after the other. Made inside the event loop that uses it. Of pymodbus' client
    it keeps what connects, closes and reads; anything else is stopped on its way to the wire."""

    def __init__(self, line: ModbusConfig) -> None:
        client = _client(line)
        client.set_max_no_responses(_NEVER)
        _guard(client)
        self._line, self._free_at = line, 0.0
        self._connect, self._close, self._is_connected = client.connect, client.close, lambda: client.connected
        self._reads: Mapping[str, Callable[..., Awaitable[ModbusPDU]]] = {
            "coil": client.read_coils,
            "discrete": client.read_discrete_inputs,
            "holding": client.read_holding_registers,
            "input": client.read_input_registers,
        }

    async def open(self) -> None:
        """Connect. Raises SourceUnavailable with the reason and the remedy."""
        try:
            connected = await cancellable(self._connect())
        except (ModbusException, OSError, ValueError, termios.error) as error:
            # The serial library's own errors are OSErrors; settings that a port does not know are termios.error.
            raise SourceUnavailable(f"{self._line.place} cannot be opened ({error}); {self._remedy()}") from error
        if not connected:
            raise SourceUnavailable(f"no connection to {self._line.place}; {self._remedy()}")

    async def read(self, unit: int, table: str, address: int, count: int) -> Answer:
        """Read from a table. Raises NoAnswer, Refused, or SourceUnavailable once the connection is lost."""
        for attempt in range(self._line.retries + 1):
            await asyncio.sleep(max(self._free_at - asyncio.get_running_loop().time(), 0.0))
            try:
                response = await cancellable(self._reads[table](address, count=count, device_id=unit))
                arrived = time.time()
            except _Nonsense as error:
                raise NoAnswer(
                    "it answers with what is no Modbus; look at the device, or who else is on the line"
                ) from error
            except ModbusException as error:
                if not self._is_connected():
                    raise SourceUnavailable(
                        f"{self._line.place} has closed the connection; {self._remedy()}"
                    ) from error
                if attempt < self._line.retries:
                    continue
                raise NoAnswer(f"no answer within {self._line.timeout:g} s") from error
            finally:
                self._free_at = asyncio.get_running_loop().time() + self._line.pause
            return Answer(_words(response, table, count), arrived)
        raise AssertionError("the last attempt returns or raises")

    async def close(self) -> None:
        """Close the connection; safe to call twice."""
        self._close()

    def _remedy(self) -> str:
        if self._line.transport == "rtu":
            return "check the cable, the name of the serial port and the right to use it"
        return "check that the device is on, the cable, host and port"


def _client(line: ModbusConfig) -> ModbusBaseClient:
    # Reconnecting and repeating are ours: the library would do both where nobody sees it.
    ours: dict[str, Any] = {"timeout": line.timeout, "retries": 0, "reconnect_delay": 0, "trace_pdu": _only_reads}
    if line.serial is not None:
        serial = line.serial
        return AsyncModbusSerialClient(
            serial.device,
            baudrate=serial.baudrate,
            parity=serial.parity[0].upper(),
            bytesize=serial.data_bits,
            stopbits=serial.stop_bits,
            **ours,
        )
    framer = FramerType.RTU if line.transport == "rtu-over-tcp" else FramerType.SOCKET
    return AsyncModbusTcpClient(line.host or "", port=line.port, framer=framer, **ours)


def _guard(client: ModbusBaseClient) -> None:
    """Let an answer that the library cannot decode end its request; else it ends the connection, with a traceback."""
    protocol = client.ctx
    handle = protocol.callback_data

    def handled(data: bytes, addr: tuple[object, ...] | None = None) -> int:
        try:
            return handle(data, addr)
        except (ModbusException, LookupError, ValueError, struct.error) as error:
            if not protocol.response_future.done():
                protocol.response_future.set_exception(_Nonsense(str(error)))
            return len(data)

    protocol.callback_data = handled  # type: ignore[method-assign]


def _only_reads(sending: bool, pdu: ModbusPDU) -> ModbusPDU:
    """Every request passes here on its way to the wire."""
    if sending and pdu.function_code not in READS:
        raise ModbusException(f"function code {pdu.function_code} is not one that reads")
    return pdu


def _words(response: ModbusPDU, table: str, count: int) -> list[int]:
    if response.isError():
        code = response.exception_code
        meaning = f"exception {code} ({EXCEPTIONS.get(code, 'of its maker')})"
        if code in _ABOUT_THE_UNIT:
            raise NoAnswer(f"it answers with {meaning}")
        raise Refused(meaning, code in _LASTING)
    if response.function_code != FUNCTION_CODES[table]:
        # Registers of another table, or what another client has asked: numbers that look as good as the right ones.
        raise NoAnswer(f"it answers with function code {response.function_code} instead of {FUNCTION_CODES[table]}")
    # Bits come in whole bytes, more of them than were asked for.
    bits = [int(bit) for bit in response.bits[:count]]
    words = list(response.registers) if table in ("holding", "input") else bits
    if len(words) != count:
        raise NoAnswer(f"it answers with {len(words)} values instead of {count}")
    return words
