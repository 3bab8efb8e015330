"""Modbus registers: where a value lives in a device, and the words that carry it."""

import math
import struct
from typing import NamedTuple

from adapters.modbus.codec import NUMBERS, Format


class Register(NamedTuple):
    """Where and how a value is served; `value = raw * scale`.

    `address` counts from 0, as on the wire. `order` is ABCD (most significant word and byte first), CDAB (words the
    other way round), BADC (bytes of each word the other way round) or DCBA (both); 64-bit values follow the same
    pattern. An integer that has a `sentinel` serves it (raw) for "not available"; floats serve NaN. A `counter` rolls
    over, any other integer stops at the ends of its range.
    """

    table: str
    address: int
    type: str
    order: str = "ABCD"
    scale: float = 1.0
    sentinel: int | None = None
    counter: bool = False

    @property
    def words(self) -> int:
        """Registers that it takes; 1 for a bit, which takes one address of its own table."""
        return Format(self.type).registers

    @property
    def can_be_unavailable(self) -> bool:
        """Whether its type can say that there is no value."""
        return self.sentinel is not None or self.type.startswith("float")

    def overlaps(self, table: str, address: int, count: int) -> bool:
        """Whether a request for `count` addresses of `table` from `address` on reads any part of it."""
        return table == self.table and self.address < address + count and address < self.address + self.words


def encode(register: Register, value: float, *, swapped: bool = False) -> list[int]:
    """The words that carry `value`, in address order, or 0 or 1 for a bit; NaN is "not available". `swapped` turns
    their order round. Raises ValueError for NaN where the type cannot say so."""
    if register.type == "bool":
        return [int(value >= 0.5)]
    raw: float = value / register.scale
    if not register.type.startswith("float"):
        raw = _integer(register, raw)
    packed = struct.pack(NUMBERS[register.type], raw)
    byte_order = "little" if register.order in ("BADC", "DCBA") else "big"
    words = [int.from_bytes(packed[i : i + 2], byte_order) for i in range(0, len(packed), 2)]  # type: ignore[arg-type]
    reverse = (register.order in ("CDAB", "DCBA")) != swapped
    return words[::-1] if reverse else words


def _integer(register: Register, raw: float) -> int:
    bits = 16 * register.words
    signed = register.type.startswith("int")
    if math.isnan(raw):
        if register.sentinel is None:
            raise ValueError(f"{register.type} without a sentinel cannot say that there is no value")
        return register.sentinel
    lowest, highest = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    if register.counter:
        return (round(raw) - lowest) % 2**bits + lowest
    # A value at the end of the range must not be taken for the sentinel that sits there.
    lowest += register.sentinel == lowest
    highest -= register.sentinel == highest
    return min(max(round(raw), lowest), highest)
