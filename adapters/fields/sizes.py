"""Sizes as people write them in a configuration: "500MB", "2GB", or a number of bytes."""

import math

from adapters.fields.durations import as_written, in_units
from adapters.fields.numbers import whole_in

_BYTES = {"TB": 10**12, "GB": 10**9, "MB": 10**6, "kB": 10**3}


def parse_size(value: object) -> int:
    """Bytes in `value`; ValueError with one sentence when it is no size."""
    size = in_units(value, _BYTES) if isinstance(value, str) else whole_in(value, lower=0)
    if size is None or not math.isfinite(size):
        raise ValueError(
            f'{as_written(value)} is not a size; write a number with kB, MB, GB or TB, such as "500MB" or "2GB", or a '
            "whole number of bytes"
        )
    return round(size)


def format_size(size: int) -> str | int:
    """The shortest way to write `size` that `parse_size` reads back to the same number."""
    return next((f"{size // one}{unit}" for unit, one in _BYTES.items() if size and size % one == 0), size)
