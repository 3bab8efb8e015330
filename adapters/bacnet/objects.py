"""Objects of a BACnet device: how they are called, and what can be read of them. Pure."""

from typing import NamedTuple

TYPES = {
    "analog-input": 0,
    "analog-output": 1,
    "analog-value": 2,
    "binary-input": 3,
    "binary-output": 4,
    "binary-value": 5,
    "loop": 12,
    "multi-state-input": 13,
    "multi-state-output": 14,
    "averaging": 18,
    "multi-state-value": 19,
    "accumulator": 23,
    "pulse-converter": 24,
    "integer-value": 45,
    "large-analog-value": 46,
    "positive-integer-value": 48,
}
"""The types of object whose present value is a number, with their numbers (ASHRAE 135, clause 21)."""

DEVICE = 8
LARGEST_INSTANCE = 4194302
"""The largest instance number of a device or an object; the one above stands for any."""

OBJECT_LIST = 76
OBJECT_NAME = 77
MAX_APDU = 62
PRESENT_VALUE = 85
SERVICES_SUPPORTED = 97
STATUS_FLAGS = 111
UNITS = 117
COV_INCREMENT = 22

_NAMES = {number: name for name, number in TYPES.items()}


class ObjectId(NamedTuple):
    """An object of a device: the number of its type, and its instance."""

    type: int
    instance: int

    def __str__(self) -> str:
        return f"{_NAMES.get(self.type, self.type)},{self.instance}"


def parse_object(text: str) -> ObjectId:
    """The object that `text` names, such as "analog-input,3". Raises ValueError with one sentence."""
    name, separator, number = text.replace(":", ",", 1).partition(",")
    type_number = TYPES.get(name.strip().lower())
    number = number.strip()
    if not separator or type_number is None:
        raise ValueError(f'must be a type and an instance such as "analog-input,3"; the types are {", ".join(TYPES)}')
    if not (number.isascii() and number.isdecimal() and int(number) <= LARGEST_INSTANCE):
        raise ValueError(f"has an instance that is no whole number from 0 to {LARGEST_INSTANCE}")
    return ObjectId(type_number, int(number))
