"""Durations as people write them in a configuration: "30s", "5min", "1h", "7d", or a number of seconds."""

import re
from collections.abc import Mapping

from adapters.fields.numbers import number_in

DAY = 86400.0
_LONGEST = 36525 * DAY

_SECONDS = {"d": DAY, "h": 3600.0, "min": 60.0, "s": 1.0}
_PATTERN = re.compile(r"\s*(\d+(?:\.\d+)?(?:e[+-]?\d+)?)\s*([A-Za-z]+)\s*", re.ASCII)


def in_units(text: str, units: Mapping[str, float]) -> float | None:
    """The amount that `text` is in one of `units`, as a multiple of what these count; None if it is none."""
    match = _PATTERN.fullmatch(text)
    return float(match[1]) * units[match[2]] if match and match[2] in units else None


def as_written(value: object) -> str:
    """`value` as it stands in the file."""
    return f'"{value}"' if isinstance(value, str) else str(value).lower()


def parse_duration(value: object) -> float:
    """Seconds in `value`; ValueError with one sentence when it is no duration, negative or beyond a century."""
    seconds = in_units(value, _SECONDS) if isinstance(value, str) else number_in(value)
    if seconds is None or not 0 <= seconds <= _LONGEST:
        raise ValueError(
            f'{as_written(value)} is not a duration; write a number with s, min, h or d, such as "30s", "5min", "1h" '
            'or "7d", or a number of seconds, up to a century'
        )
    return seconds


def format_duration(seconds: float) -> str:
    """The shortest way to write `seconds` that `parse_duration` reads back to the same number."""
    for unit in ("d", "h", "min"):
        if seconds and seconds % _SECONDS[unit] == 0:
            return f"{seconds / _SECONDS[unit]:.0f}{unit}"
    return f"{seconds:.0f}s" if seconds == int(seconds) else f"{seconds!r}s"


def spoken_duration(seconds: float) -> str:
    """`seconds` as people say them: 90 s, 15 min, 6 h, 24 h."""
    for unit in ("h", "min"):
        if seconds and seconds % _SECONDS[unit] == 0:
            return f"{seconds / _SECONDS[unit]:.0f} {unit}"
    return f"{seconds:g} s"
