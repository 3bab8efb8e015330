"""What the words of a Modbus answer mean to the channels of the daemon: readings."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

from adapters.channel import Binding, Watched, put_to_work
from adapters.modbus.client import Answer
from adapters.modbus.codec import Format, decode, is_available
from adapters.modbus.config import ModbusConfig
from adapters.modbus.plan import Point, Request
from adapters.reading import Fault, Reading

# Counts that lie further apart than so many polls make no power: what was used meanwhile is not what is used now.
_POLLS_IN_A_STRETCH = 10


class ModbusChannel(Watched):
    """A channel at work: what has to be read for it, and how its number is written there."""

    def __init__(self, binding: Binding, table: ModbusConfig) -> None:
        channel = binding.channel
        self.format: Format = channel.format
        super().__init__(binding, _POLLS_IN_A_STRETCH * table.poll, self.format.rollover)
        self.register: int = channel.register
        """Its first register, as the operator numbers them."""
        address = self.register - table.first_register
        self.point = Point(channel.unit_id, channel.table, address, self.format.registers)

    @property
    def place(self) -> str:
        """Where it stands, in the operator's words."""
        bit = "" if self.format.bit is None else f" bit {self.format.bit}"
        return f"unit {self.point.unit} {self.point.table} {self.register}{bit}"


class Channels:
    """The channels of a source by what has to be read."""

    def __init__(self, bindings: Sequence[Binding], table: ModbusConfig) -> None:
        self._table = table
        self._at: dict[Point, list[ModbusChannel]] = {}
        self.replace(bindings)

    def replace(self, bindings: Sequence[Binding]) -> None:
        """These are the channels from now on; what is remembered of those that stay is kept."""
        before = [channel for at_point in self._at.values() for channel in at_point]
        self._at = {}
        for channel in put_to_work(bindings, before, lambda one: ModbusChannel(one, self._table)):
            self._at.setdefault(channel.point, []).append(channel)

    @property
    def points(self) -> list[Point]:
        """Everything that has to be read."""
        return list(self._at)

    def names(self, point: Point) -> str:
        """The channels at a point and where that is, for the log."""
        at_point = self._at[point]
        return f"{', '.join(channel.id for channel in at_point)} ({at_point[0].place})"

    def readings(self, request: Request, answer: Answer) -> Iterator[Reading]:
        """The readings that the answer to `request` brings."""
        for point in request.points:
            begin = point.address - request.address
            words = answer.words[begin : begin + point.size]
            for channel in self._at[point]:
                reading = _reading(channel, words, answer.time)
                if reading is not None:
                    yield reading

    def refused(self, point: Point) -> list[Reading]:
        """Bad readings of the channels at `point`, which the device does not give away."""
        return [channel.converter.bad(time.time(), Fault.REFUSED_BY_DEVICE) for channel in self._at[point]]


def _reading(channel: ModbusChannel, words: Sequence[int], when: float) -> Reading | None:
    if not is_available(words, channel.format):
        return channel.converter.bad(when, Fault.NOT_AVAILABLE)
    return channel.converter.reading(when, decode(words, channel.format), sent=tuple(words))
