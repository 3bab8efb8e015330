"""What a device answers: application-tagged values as numbers, text and status flags (ASHRAE 135, 20.2). Pure."""

from __future__ import annotations

import struct
from typing import NamedTuple

from adapters.reading import Quality

NULL, BOOLEAN, UNSIGNED, INTEGER, REAL, DOUBLE, CHARACTERS, BITS, ENUMERATED, OBJECT = 0, 1, 2, 3, 4, 5, 7, 8, 9, 12

_LONGEST_WHOLE = 8
_ENCODINGS = {0: "utf-8", 3: "utf-32-be", 4: "utf-16-be", 5: "latin-1"}
_LONGEST_TEXT = 80


class Tagged(NamedTuple):
    """A value as it came: the number of its application tag, its octets, and its length field, where a Boolean is."""

    tag: int
    data: bytes
    length: int = 0


class Unreadable(Exception):
    """A value that is not what it should be; the text says what it is instead."""


class Flags(NamedTuple):
    """The status flags of an object."""

    in_alarm: bool = False
    fault: bool = False
    overridden: bool = False
    out_of_service: bool = False

    @property
    def quality(self) -> Quality:
        """How far the present value can be believed. An alarm is about a value that was measured. A value out of
        service is somebody's, not the sensor's; an overridden one does not follow what it stands for."""
        if self.fault or self.out_of_service:
            return Quality.BAD
        return Quality.UNCERTAIN if self.overridden else Quality.GOOD

    def __str__(self) -> str:
        return ", ".join(name.replace("_", "-") for name, is_set in self._asdict().items() if is_set)


def number(value: Tagged) -> float | None:
    """The number in `value`, which may be infinite or NaN; None for BACnet's Null. Raises Unreadable."""
    match value.tag:
        case 0:
            return None
        case 1:
            return float(value.length != 0)
        case 2 | 9:
            return float(_whole(value, signed=False))
        case 3:
            return float(_whole(value, signed=True))
        case 4 if len(value.data) == 4:
            return float(struct.unpack(">f", value.data)[0])
        case 5 if len(value.data) == 8:
            return float(struct.unpack(">d", value.data)[0])
    raise Unreadable(f"is no number (application tag {value.tag}, {len(value.data)} octets)")


def flags(value: Tagged) -> Flags:
    """The status flags in `value`. Raises Unreadable."""
    return Flags(*bits(value)[:4])


def bits(value: Tagged) -> list[bool]:
    """The bits of a bit string, the first one first. Raises Unreadable."""
    if value.tag != BITS or not value.data or value.data[0] > 7 or (len(value.data) == 1 and value.data[0]):
        raise Unreadable("is no bit string")
    unused, octets = value.data[0], value.data[1:]
    everything = [bool(octet >> place & 1) for octet in octets for place in range(7, -1, -1)]
    return everything[: len(everything) - unused]


def whole(value: Tagged) -> int:
    """The whole number in `value`, 0 or more. Raises Unreadable."""
    if value.tag not in (UNSIGNED, ENUMERATED):
        raise Unreadable("is no whole number")
    return _whole(value, signed=False)


def text(value: Tagged) -> str:
    """The text in `value`, printable and shortened. Raises Unreadable."""
    if value.tag != CHARACTERS or not value.data:
        raise Unreadable("is no text")
    found = value.data[1:].decode(_ENCODINGS.get(value.data[0], "latin-1"), "replace")[:_LONGEST_TEXT]
    return "".join(character if character.isprintable() else " " for character in found).strip()


def object_id(value: Tagged) -> tuple[int, int]:
    """The type and the instance of the object that `value` names. Raises Unreadable."""
    if value.tag != OBJECT or len(value.data) != 4:
        raise Unreadable("names no object")
    (packed,) = struct.unpack(">I", value.data)
    return packed >> 22, packed & 0x3FFFFF


def _whole(value: Tagged, *, signed: bool) -> int:
    if not 1 <= len(value.data) <= _LONGEST_WHOLE:
        raise Unreadable(f"is a whole number of {len(value.data)} octets")
    return int.from_bytes(value.data, signed=signed)
