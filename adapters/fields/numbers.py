"""What counts as a number, in a configuration, on a command line and in a request."""

import math
import sys


def number_in(value: object) -> float | None:
    """`value` as a float; None if it is no number, not finite or larger than any float. True and false are none."""
    # Compared, not converted: an integer in TOML may be larger than any float.
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        return None
    return float(value)


def whole_in(value: object, lower: float = -math.inf, upper: float = math.inf) -> int | None:
    """`value` as an int; None if it is no whole number from `lower` to `upper`. True and false are none."""
    if isinstance(value, bool) or not isinstance(value, int) or not lower <= value <= upper:
        return None
    return value


def float_in(text: str) -> float:
    """The number that `text` is, with the digits of ASCII and no separators, as others read it; else ValueError."""
    return float(text if text.isascii() and "_" not in text else "")


def read_number(text: str) -> float | None:
    """The finite number that `text` is; None if it is none."""
    try:
        return number_in(float_in(text))
    except ValueError:
        return None


def read_whole(text: str) -> int | None:
    """The whole number without a sign that `text` is; None if it is none."""
    try:
        return int(text) if text.isascii() and text.isdecimal() else None
    except ValueError:
        # Python reads no number of thousands of digits.
        return None


def is_level(value: float) -> bool:
    """Whether `value` can be a probability content or a quantile level."""
    return 0 < value < 1
