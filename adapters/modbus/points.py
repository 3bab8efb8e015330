"""What the words of a Modbus answer mean to the channels of the daemon: readings."""

from collections.abc import Iterator, Sequence
from functools import partial

from adapters.channel import Binding
from adapters.modbus.client import Answer
from adapters.modbus.codec import Format, decode, is_available
from adapters.modbus.config import ModbusConfig
from adapters.modbus.plan import Point, Request
from adapters.reading import Fault, Quality, Reading
from adapters.watched import POLLS_IN_A_STRETCH, Channels, Verdict, Watched


class ModbusChannel(Watched):
    """A channel at work: what has to be read for it, and how its number is written there."""

    def __init__(self, binding: Binding, table: ModbusConfig) -> None:
        channel = binding.channel
        self.format: Format = channel.format
        super().__init__(binding, POLLS_IN_A_STRETCH * table.poll, self.format.rollover)
        self.register: int = channel.register
        """Its first register, as the operator numbers them."""
        address = self.register - table.first_register
        self.point = Point(channel.unit_id, channel.table, address, self.format.registers)
        bit = "" if self.format.bit is None else f" bit {self.format.bit}"
        self.place = f"unit {channel.unit_id} {channel.table} {self.register}{bit}"

    def judged(self, words: Sequence[int]) -> Verdict:
        if not is_available(words, self.format):
            nothing = "not available: the device has no value here now"
            return Verdict(None, Quality.BAD, Fault.NOT_AVAILABLE, nothing)
        return Verdict(decode(words, self.format))


def readings(channels: Channels[ModbusChannel], request: Request, answer: Answer) -> Iterator[Reading]:
    for point in request.points:
        begin = point.address - request.address
        words = tuple(answer.words[begin : begin + point.size])
        yield from channels.readings(point, partial(ModbusChannel.judged, words=words), answer.time, words)
