"""Registers of a Modbus device as numbers: types, word and byte order, values that stand for "not available"."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

ORDERS = ("ABCD", "CDAB", "BADC", "DCBA")
"""Where the bytes A (most significant) to D of a 32-bit number stand in its two registers: in order, words swapped,
bytes swapped in every word, both. With more or fewer registers the same swaps apply."""

# How `struct` calls the number in bytes that run from the most to the least significant.
NUMBERS = {
    "int16": ">h",
    "uint16": ">H",
    "int32": ">i",
    "uint32": ">I",
    "int64": ">q",
    "uint64": ">Q",
    "float32": ">f",
    "float64": ">d",
}
REGISTERS_AT_MOST, BITS_AT_MOST = 125, 2000
"""Registers, or bits, that one answer can hold (Modbus application protocol 1.1b3, 6.1 and 6.3)."""

TABLES = ("holding", "input", "coil", "discrete")
BIT_TABLES = ("coil", "discrete")
"""The four tables of a device, and those of bits."""

TYPES = (*NUMBERS, "bool")
"""Every type that a channel can have. A bool is a coil or a discrete input, a bit of a register, or a register that is
not 0."""


@dataclass(frozen=True)
class Format:
    """How the registers of a channel hold its number. `bit`, of a bool only, counts from 0, the least significant;
    `not_available` lists numbers that mean no value: raw patterns (0x8000), decoded numbers (-32768), or NaN."""

    type: str
    order: str = "ABCD"
    bit: int | None = None
    not_available: tuple[float, ...] = ()

    @property
    def registers(self) -> int:
        return 1 if self.type == "bool" else struct.calcsize(NUMBERS[self.type]) // 2

    @property
    def rollover(self) -> float | None:
        """The value at which a counter of this type starts again from 0; None where that is not known."""
        return float(2 ** (16 * self.registers)) if self.type.startswith("uint") else None


def decode(words: Sequence[int], format: Format) -> float:
    """The number in `words` (each 0 to 65535, as many as the format has registers)."""
    if format.type == "bool":
        word = int.from_bytes(_ordered(words, format.order))
        return float(word != 0 if format.bit is None else word >> format.bit & 1)
    (number,) = struct.unpack(NUMBERS[format.type], _ordered(words, format.order))
    return float(number)


def is_available(words: Sequence[int], format: Format) -> bool:
    """Whether `words` hold a value, and not a number that the device puts where it has none."""
    if not format.not_available:
        return True
    pattern, number = int.from_bytes(_ordered(words, format.order)), decode(words, format)
    return not any(
        math.isnan(number) if math.isnan(absent) else absent in (pattern, number) for absent in format.not_available
    )


def other_orders(words: Sequence[int], format: Format) -> dict[str, float]:
    """The number that `words` would be in each of the other orders, where it is another finite one."""
    value = decode(words, format)
    found = {order: decode(words, Format(format.type, order, format.bit)) for order in ORDERS if order != format.order}
    return {order: number for order, number in found.items() if math.isfinite(number) and number != value}


def other_sign(words: Sequence[int], format: Format) -> tuple[str, float] | None:
    """The whole number that `words` would be with a sign, or without, where that is another one; and the type."""
    twin = format.type.removeprefix("u") if format.type.startswith("uint") else f"u{format.type}"
    if twin not in NUMBERS or format.type not in NUMBERS:
        return None
    number = decode(words, Format(twin, format.order))
    return (twin, number) if number != decode(words, format) else None


def _ordered(words: Sequence[int], order: str) -> bytes:
    """The bytes of `words` from the most to the least significant."""
    in_order = reversed(words) if order in ("CDAB", "DCBA") else words
    end = "little" if order in ("BADC", "DCBA") else "big"
    return b"".join(word.to_bytes(2, end) for word in in_order)  # type: ignore[arg-type]
