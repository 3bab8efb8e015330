"""Durations as people write them in a configuration: "30s", "5min", "1h", "7d", or a number of seconds."""

from __future__ import annotations

import re

from adapters.fields.numbers import number_in

DAY = 86400.0
_LONGEST = 36525 * DAY

_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": DAY}
_PATTERN = re.compile(r"\s*(\d+(?:\.\d+)?(?:e[+-]?\d+)?)\s*(s|min|h|d)\s*", re.ASCII)


def parse_duration(value: object) -> float:
    """Seconds in `value`; ValueError with one sentence when it is no duration, negative or beyond a century."""
    if isinstance(value, str):
        match = _PATTERN.fullmatch(value)
        if match:
            seconds = float(match[1]) * _SECONDS[match[2]]
            if seconds <= _LONGEST:
                return seconds
    else:
        number = number_in(value)
        if number is not None and 0 <= number <= _LONGEST:
            return number
    shown = f'"{value}"' if isinstance(value, str) else str(value).lower()
    raise ValueError(
        f'{shown} is not a duration; write a number with s, min, h or d, such as "30s", "5min", "1h" or "7d", '
        "or a number of seconds, up to a century"
    )


def format_duration(seconds: float) -> str:
    """The shortest way to write `seconds` that `parse_duration` reads back to the same number."""
    for unit in ("d", "h", "min"):
        if seconds and seconds % _SECONDS[unit] == 0:
            return f"{seconds / _SECONDS[unit]:.0f}{unit}"
    return f"{seconds:.0f}s" if seconds == int(seconds) else f"{seconds!r}s"
