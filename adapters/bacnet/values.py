"""What a device answers, as bacpypes3 decodes it: numbers, text and status flags. Pure."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

from adapters.reading import Quality

Value = float | str | Sequence[int]
"""A number, a text, a bit string as a list, an object as (type, instance), or () for BACnet's Null."""

_LONGEST_TEXT = 80

_Read = TypeVar("_Read")


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


def known(read: Callable[[Value], _Read], value: Value | Exception) -> _Read | None:
    """What `read` makes of `value`; None where it makes nothing of it, or a device has refused it."""
    try:
        return None if isinstance(value, Exception) else read(value)
    except Unreadable:
        return None


def number(value: Value) -> float | None:
    """The number in `value`, which may be infinite or NaN; None for BACnet's Null. Raises Unreadable."""
    if value == ():
        return None
    try:
        if isinstance(value, int | float):
            return float(value)
    except OverflowError:
        raise Unreadable("is a number too large") from None
    raise Unreadable(f"is no number (but a {type(value).__name__})")


def flags(value: Value) -> Flags:
    """The status flags in `value`. Raises Unreadable."""
    return Flags(*bits(value)[:4])


def bits(value: Value) -> list[bool]:
    """The bits of a bit string, the first one first. Raises Unreadable."""
    if not isinstance(value, list):
        raise Unreadable("is no bit string")
    return [bool(bit) for bit in value]


def whole(value: Value) -> int:
    """The whole number in `value`, 0 or more. Raises Unreadable."""
    if not isinstance(value, int) or value < 0:
        raise Unreadable("is no whole number")
    return int(value)


def text(value: Value) -> str:
    """The text in `value`, printable and shortened. Raises Unreadable."""
    if not isinstance(value, str):
        raise Unreadable("is no text")
    return "".join(character if character.isprintable() else " " for character in value[:_LONGEST_TEXT]).strip()


def object_id(value: Value) -> tuple[int, int]:
    """The type and the instance of the object that `value` names. Raises Unreadable."""
    if not isinstance(value, tuple) or len(value) != 2:
        raise Unreadable("names no object")
    return int(value[0]), int(value[1])
