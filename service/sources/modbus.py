"""Sources of kind "modbus": units behind one connection, polled."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from adapters.modbus.client import TRANSPORTS, Line
from adapters.modbus.codec import ORDERS, TYPES, Format
from adapters.modbus.plan import REGISTERS_AT_MOST, TABLES, Limits
from adapters.modbus.source import ModbusChannel, ModbusSource, Numbering
from service.fields.durations import format_duration
from service.fields.tables import TABLE
from service.fields.values import Duration, Flag, PositiveDuration, Text, Timeout, choice, number, whole
from service.sources.channel import Binding, ChannelConfig, SourceKind, edge_of

_INHERITED = ("unit_id", "table", "type", "order", "not_available", "stuck_after")


def number_type(value: object) -> str:
    if value == "string":
        raise ValueError(f'"string" is text, which cannot be measured; choose a type of number: {", ".join(TYPES)}')
    return choice(*TYPES)(value)


def absent(value: object) -> float:
    """A number that stands for no value; NaN is one that devices use."""
    # One and the same NaN, so that a configuration that is read twice equals itself.
    return math.nan if isinstance(value, float) and math.isnan(value) else number(value)


UnitId = Annotated[int, BeforeValidator(whole(0, 255))]
ModbusTable = Annotated[str, BeforeValidator(choice(*TABLES))]
NumberType = Annotated[str, BeforeValidator(number_type)]
Order = Annotated[str, BeforeValidator(choice(*ORDERS))]
Absent = tuple[Annotated[float, BeforeValidator(absent)], ...]
_ABSENT = "a list of numbers that mean no value, such as [0x8000, nan]"


class SerialConfig(BaseModel):
    """The serial port of transport "rtu"."""

    model_config = TABLE

    device: Text = Field(description='the serial port, such as "/dev/ttyUSB0"')
    baudrate: Annotated[int, BeforeValidator(whole(300, 4_000_000))] = 19200
    parity: Annotated[str, BeforeValidator(choice("even", "odd", "none"))] = "even"
    data_bits: Annotated[int, BeforeValidator(whole(7, 8))] = 8
    stop_bits: Annotated[int, BeforeValidator(whole(1, 2))] = 1


class ModbusConfig(BaseModel):
    """[sources.<name>] of kind "modbus": units behind one connection, polled, read only."""

    model_config = TABLE

    kind: Literal["modbus"] = "modbus"
    transport: Annotated[str, BeforeValidator(choice(*TRANSPORTS))] = "tcp"
    host: Text | None = None
    port: Annotated[int, BeforeValidator(whole(1, 65535))] = 502
    serial: SerialConfig | None = None
    poll: PositiveDuration = 10.0
    timeout: Timeout = 3.0
    retries: Annotated[int, BeforeValidator(whole(0, 10))] = 1
    pause: Duration = 0.0
    batch: Flag = True
    max_registers: Annotated[int, BeforeValidator(whole(1, REGISTERS_AT_MOST))] = REGISTERS_AT_MOST
    fill_gaps: Annotated[int, BeforeValidator(whole(0, REGISTERS_AT_MOST))] = 8
    first_register: Annotated[int, BeforeValidator(whole(0, 1))] = Field(
        description="0 or 1, the number that the device's manual gives to the first register"
    )
    unit_id: UnitId = 1
    table: ModbusTable = "holding"
    type: NumberType | None = None
    order: Order = "ABCD"
    not_available: Absent = Field(default=(), description=_ABSENT)
    stuck_after: PositiveDuration | None = None

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        if self.transport == "rtu" and (self.serial is None or self.host is not None):
            raise ValueError(
                'transport "rtu" is a serial port: give serial = { device = "/dev/ttyUSB0" }, and no host; '
                'a gateway that passes RTU frames on over TCP is transport "rtu-over-tcp"'
            )
        if self.transport != "rtu" and (self.host is None or self.serial is not None):
            raise ValueError(f'transport "{self.transport}" needs host, such as host = "192.168.1.20", and no serial')
        return self

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        place = self.serial.device if self.serial is not None else f"{self.host}:{self.port}"
        return f"{self.transport} {place}, polled every {format_duration(self.poll)}"


with warnings.catch_warnings():
    # "register" is also what Python calls a method of every abstract class; nobody calls it here.
    warnings.filterwarnings("ignore", message='Field name "register"')

    class ModbusChannelConfig(ChannelConfig):
        """A channel of a Modbus source; what is None is taken over from the source."""

        register: Annotated[int, BeforeValidator(whole(0, 65536))] = Field(
            description="the number of its first register, as the device's manual counts"
        )
        bit: Annotated[int, BeforeValidator(whole(0, 15))] | None = None
        unit_id: UnitId | None = None
        table: ModbusTable | None = None
        type: NumberType | None = None
        order: Order | None = None
        not_available: Absent | None = Field(default=None, description=_ABSENT)
        stuck_after: PositiveDuration | None = None

        @property
        def address(self) -> str:
            """Unit, table, register and type."""
            bit = "" if self.bit is None else f" bit {self.bit}"
            order = "" if self.type == "bool" else f" {self.order}"
            return f"unit {self.unit_id} {self.table} {self.register}{bit} {self.type}{order}"

        @property
        def switched(self) -> bool:
            """Whether it is a single bit."""
            return self.type == "bool"

        @property
        def format(self) -> Format:
            """How its registers hold the number; of a channel that is `within` its source."""
            return Format(str(self.type), str(self.order), self.bit, self.not_available or ())

        def within(self, table: ModbusConfig) -> Self:
            """With what the source says for all of its channels; ValueError where the result cannot be read."""
            taken = {name: getattr(table, name) for name in _INHERITED if getattr(self, name) is None}
            bits = (taken.get("table") or self.table) in ("coil", "discrete")
            if bits or self.bit is not None:
                # What the source says of numbers does not concern a single bit.
                taken["type"] = self.type or "bool"
            channel = self.model_copy(update=taken)
            if channel.type is None:
                raise ValueError(
                    f"type is missing; give it here or in sources.{self.source}, one of {', '.join(TYPES)}"
                )
            if bits and (channel.type != "bool" or channel.bit is not None):
                raise ValueError(f'a {channel.table} is a single bit: its type is "bool", and it has no bit')
            if channel.bit is not None and channel.type != "bool":
                raise ValueError(f'bit picks one bit of a register, whose type is "bool" and not "{channel.type}"')
            last = 65535 + table.first_register
            end = channel.register + channel.format.registers - 1
            if not table.first_register <= channel.register or end > last:
                raise ValueError(
                    f"register {channel.register} is not there; where first_register is {table.first_register}, a "
                    f"{channel.type} can begin at {table.first_register} to {last - channel.format.registers + 1}"
                )
            return channel


def _build(name: str, table: ModbusConfig, bindings: Sequence[Binding]) -> ModbusSource:
    line = Line(
        transport=table.transport,
        host=table.host or "",
        port=table.port,
        timeout=table.timeout,
        retries=table.retries,
        pause=table.pause,
    )
    if table.serial is not None:
        line = replace(
            line,
            device=table.serial.device,
            baudrate=table.serial.baudrate,
            parity=table.serial.parity[0].upper(),
            data_bits=table.serial.data_bits,
            stop_bits=table.serial.stop_bits,
        )
    return ModbusSource(
        name,
        line,
        [_channel(binding, table) for binding in bindings],
        poll=table.poll,
        limits=Limits(table.batch, table.max_registers, table.fill_gaps),
        numbering=Numbering(table.first_register, table.unit_id),
    )


def _rebind(source: ModbusSource, table: ModbusConfig, bindings: Sequence[Binding]) -> None:
    source.rebind([_channel(binding, table) for binding in bindings])


def _channel(binding: Binding, table: ModbusConfig) -> ModbusChannel:
    channel: ModbusChannelConfig = binding.channel
    assert channel.unit_id is not None
    assert channel.table is not None
    return ModbusChannel(
        binding.id,
        channel.register - table.first_register,
        channel.format,
        unit=channel.unit_id,
        table=channel.table,
        edge=edge_of(channel, binding.unit, channel.format.rollover, binding.usual),
        stuck_after=channel.stuck_after,
        register=channel.register,
    )


KIND = SourceKind("modbus", ModbusConfig, ModbusChannelConfig, True, 'register = 0, type = "float32"', _build, _rebind)
