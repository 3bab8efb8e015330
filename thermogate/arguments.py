"""What people pass in a notebook, in Python's own types."""

from collections.abc import Iterable, Mapping
from datetime import timedelta
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """`value` with NumPy's numbers, texts and arrays as Python's, in lists, tuples and tables as well: an array becomes
    a list, one without a dimension its only item."""
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value] if value.ndim else plain(value[()])
    # item() would take the unit from a moment or a duration.
    if isinstance(value, np.generic) and not isinstance(value, np.datetime64 | np.timedelta64):
        return float(value) if isinstance(value, np.floating) else value.item()
    if isinstance(value, Mapping):
        return {plain(key): plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return tuple(plain(item) for item in value) if isinstance(value, tuple) else value


def items(value: Any) -> Any:
    """The items of `value` as a list of plain ones, where it has any, such as a Series; otherwise `value`, plain."""
    found = plain(value)
    if isinstance(found, Iterable) and not isinstance(found, str | bytes | Mapping):
        return [plain(item) for item in found]
    return found


def duration(value: Any) -> Any:
    """A duration as the configuration knows it: a timedelta as seconds, anything else plain."""
    return value.total_seconds() if isinstance(value, timedelta) else plain(value)
