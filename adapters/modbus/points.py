"""What the words of a Modbus answer mean to the channels of the daemon: readings."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from adapters.edge import PLAIN, Edge, LiveConverter
from adapters.modbus.client import Answer
from adapters.modbus.codec import Format, decode, is_available
from adapters.modbus.plan import Point, Request
from adapters.reading import Fault, Reading


@dataclass(frozen=True)
class ModbusChannel:
    """Where the raw value of channel `id` ("zone/channel") stands, how it is written there, and what becomes of it.

    `address` counts from 0; `register` is the same as the operator numbers it. A raw value that has not changed for
    `stuck_after` s is uncertain, for twice as long bad.
    """

    id: str
    address: int
    format: Format
    unit: int = 1
    table: str = "holding"
    edge: Edge = PLAIN
    stuck_after: float | None = None
    register: int = 0

    @property
    def point(self) -> Point:
        """What has to be read for it."""
        return Point(self.unit, self.table, self.address, self.format.registers)

    @property
    def place(self) -> str:
        """Where it stands, in the operator's words."""
        bit = "" if self.format.bit is None else f" bit {self.format.bit}"
        return f"unit {self.unit} {self.table} {self.register}{bit}"


_Watched = tuple[ModbusChannel, LiveConverter]


class Channels:
    """The channels of a source, and what has to be remembered of their last values."""

    def __init__(self, channels: Sequence[ModbusChannel], longest_stretch: float) -> None:
        """`longest_stretch`: no power is made of counts that lie further apart, in s."""
        self._longest_stretch = longest_stretch
        self._at: dict[Point, list[_Watched]] = {}
        self.replace(channels)

    def replace(self, channels: Sequence[ModbusChannel]) -> None:
        """These are the channels from now on; what is remembered of those that stay is kept."""
        known = {watched[0]: watched for at_point in self._at.values() for watched in at_point}
        self._at = {}
        for channel in channels:
            self._at.setdefault(channel.point, []).append(known.get(channel) or self._watched(channel))

    def _watched(self, channel: ModbusChannel) -> _Watched:
        return channel, LiveConverter(channel.id, channel.edge, self._longest_stretch, channel.stuck_after)

    @property
    def points(self) -> list[Point]:
        """Everything that has to be read."""
        return list(self._at)

    def names(self, point: Point) -> str:
        """The channels at a point and where that is, for the log."""
        return f"{', '.join(channel.id for channel, _ in self._at[point])} ({self._at[point][0][0].place})"

    def readings(self, request: Request, answer: Answer) -> Iterator[Reading]:
        """The readings that the answer to `request` brings."""
        for point in request.points:
            begin = point.address - request.address
            words = answer.words[begin : begin + point.size]
            for channel, converter in self._at[point]:
                reading = _reading(channel, converter, words, answer.time)
                if reading is not None:
                    yield reading

    def refused(self, point: Point) -> list[Reading]:
        """Bad readings of the channels at `point`, which the device does not give away."""
        return [converter.bad(time.time(), Fault.REFUSED_BY_DEVICE) for _, converter in self._at[point]]


def _reading(channel: ModbusChannel, converter: LiveConverter, words: Sequence[int], when: float) -> Reading | None:
    if not is_available(words, channel.format):
        return converter.bad(when, Fault.NOT_AVAILABLE)
    return converter.reading(when, decode(words, channel.format), sent=tuple(words))
