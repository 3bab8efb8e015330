"""Sizes as people write them in a configuration: "500MB", "2GB", or a number of bytes."""

from __future__ import annotations

import math
import re

from adapters.fields.numbers import whole_in

_BYTES = {"kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_PATTERN = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(kB|MB|GB|TB)\s*")


def parse_size(value: object) -> int:
    """Bytes in `value`; ValueError with one sentence when it is no size."""
    if isinstance(value, str):
        match = _PATTERN.fullmatch(value)
        size = float(match[1]) * _BYTES[match[2]] if match else math.inf
        if math.isfinite(size):
            return round(size)
    else:
        whole = whole_in(value, lower=0)
        if whole is not None:
            return whole
    shown = f'"{value}"' if isinstance(value, str) else str(value).lower()
    raise ValueError(
        f'{shown} is not a size; write a number with kB, MB, GB or TB, such as "500MB" or "2GB", or a whole number of '
        "bytes"
    )


def format_size(size: int) -> str | int:
    """The shortest way to write `size` that `parse_size` reads back to the same number."""
    for unit in ("TB", "GB", "MB", "kB"):
        if size and size % _BYTES[unit] == 0:
            return f"{size // _BYTES[unit]}{unit}"
    return size
