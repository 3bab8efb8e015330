"""The tables of kind "modbus": units behind one connection, polled."""

from __future__ import annotations

import math
import warnings
from typing import Annotated, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from adapters.channel import LiveConfig, WatchedChannelConfig
from adapters.fields.durations import format_duration
from adapters.fields.tables import Table
from adapters.fields.values import Duration, Flag, Port, PositiveDuration, Retries, Text, Timeout, choice, number, whole
from adapters.modbus.codec import BIT_TABLES, ORDERS, REGISTERS_AT_MOST, TABLES, TYPES, Format

TRANSPORTS = ("tcp", "rtu-over-tcp", "rtu")


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


class SerialConfig(Table):
    """The serial port of transport "rtu"."""

    device: Text = Field(description='the serial port, such as "/dev/ttyUSB0"')
    baudrate: Annotated[int, BeforeValidator(whole(300, 4_000_000))] = Field(
        default=19200, description="bits per second"
    )
    parity: Annotated[str, BeforeValidator(choice("even", "odd", "none"))] = Field(
        default="even", description='with `"none"` most devices want two stop bits'
    )
    data_bits: Annotated[int, BeforeValidator(whole(7, 8))] = Field(default=8, description="RTU needs 8")
    stop_bits: Annotated[int, BeforeValidator(whole(1, 2))] = Field(default=1, description="stop bits")


with warnings.catch_warnings():
    # "register" is also what Python calls a method of every abstract class; nobody calls it here.
    warnings.filterwarnings("ignore", message='Field name "register"')

    class ModbusChannelConfig(WatchedChannelConfig):
        """A channel of a Modbus source; what is None is taken over from the source."""

        register: Annotated[int, BeforeValidator(whole(0, 65536))] = Field(
            description="the number of its first register, as the device's manual counts"
        )
        bit: Annotated[int, BeforeValidator(whole(0, 15))] | None = Field(
            default=None, description="one bit of the register, 0 the least significant"
        )
        unit_id: UnitId | None = Field(default=None, description="unit to read from")
        table: ModbusTable | None = Field(default=None, description="table of the device")
        type: NumberType | None = Field(
            default=None, description="how the number is written; a coil, a discrete input and a bit are bool"
        )
        order: Order | None = Field(default=None, description="order of its bytes")
        not_available: Absent | None = Field(default=None, description=_ABSENT)

        @property
        def address(self) -> str:
            bit = "" if self.bit is None else f" bit {self.bit}"
            order = "" if self.type == "bool" else f" {self.order}"
            return f"unit {self.unit_id} {self.table} {self.register}{bit} {self.type}{order}"

        @property
        def switched(self) -> bool:
            return self.type == "bool"

        @property
        def format(self) -> Format:
            """How its registers hold the number; of a channel that is `within` its source."""
            return Format(str(self.type), str(self.order), self.bit, self.not_available or ())

        def within(self, table: ModbusConfig) -> Self:
            channel = super().within(table)
            bits = channel.table in BIT_TABLES
            if bits or self.bit is not None:
                # What the source says of numbers does not concern a single bit.
                channel = channel.model_copy(update={"type": self.type or "bool"})
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


class ModbusConfig(LiveConfig):
    """[sources.<name>] of kind "modbus": units behind one connection, polled, read only."""

    channel: ClassVar = ModbusChannelConfig
    example: ClassVar = 'register = 0, type = "float32"'
    source: ClassVar = "adapters.modbus.source:ModbusSource"

    kind: Literal["modbus"] = "modbus"
    transport: Annotated[str, BeforeValidator(choice(*TRANSPORTS))] = Field(
        default="tcp", description="Modbus TCP, RTU frames over TCP, or a serial port"
    )
    host: Text | None = Field(default=None, description='device or gateway; required unless `"rtu"`')
    port: Port = Field(default=502, description="TCP port")
    serial: SerialConfig | None = Field(default=None, description='the serial port; required for `"rtu"`')
    poll: PositiveDuration = Field(default=10.0, description="time between two readings of a channel")
    timeout: Timeout = Field(default=3.0, description="time limit for a connection and each answer")
    retries: Retries = Field(default=1, description="repeats of a request without an answer")
    pause: Duration = Field(default=0.0, description="pause between two requests")
    batch: Flag = Field(default=True, description="false: one request per channel")
    max_registers: Annotated[int, BeforeValidator(whole(1, REGISTERS_AT_MOST))] = Field(
        default=REGISTERS_AT_MOST, description="registers in one request"
    )
    fill_gaps: Annotated[int, BeforeValidator(whole(0, REGISTERS_AT_MOST))] = Field(
        default=8, description="registers without a channel that are read to save a request"
    )
    first_register: Annotated[int, BeforeValidator(whole(0, 1))] = Field(
        description="0 or 1, the number that the device's manual gives to the first register"
    )
    unit_id: UnitId = 1
    table: ModbusTable = "holding"
    type: NumberType | None = None
    order: Order = "ABCD"
    not_available: Absent = Field(default=(), description=_ABSENT)

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
    def place(self) -> str:
        return self.serial.device if self.serial is not None else f"{self.host}:{self.port}"

    @property
    def described(self) -> str:
        return f"{self.transport} {self.place}, polled every {format_duration(self.poll)}"
