"""Written times to UTC seconds, with the clock changes of local time."""

import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import numpy.typing as npt

from adapters.errors import SourceConfigError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

EARLIEST = 0.0
LATEST = datetime(2100, 1, 1, tzinfo=UTC).timestamp()
"""Telemetry is dated in [EARLIEST, LATEST); outside it are loggers' sentinels and milliseconds taken for seconds."""

_EPOCH = datetime(1970, 1, 1)  # noqa: DTZ001 - wall-clock time counts from a wall-clock epoch
_DAY = 86400.0

_OF_TIME = frozenset("HIMSfpXc")
"""Directives of strptime for parts of the time of day."""

_UTC = re.compile(r"(?<![a-z])(?:z|utc|gmt)(?![a-z])", re.IGNORECASE)
"""What says that a time is in UTC."""

Parser = Callable[[str], tuple[float, bool]]
"""Seconds since 1970, and whether they are wall-clock time; ValueError if the text is no timestamp."""


def timestamp_parser(pattern: str) -> Parser:
    """A parser for `pattern`: "iso8601", "epoch" (seconds since 1970, UTC) or a strptime pattern, in which Z, UTC or
    GMT after the time, or where %Z is, means UTC. SourceConfigError for one that cannot be parsed, does not hold a full
    date, or cannot tell an afternoon from a morning."""
    if pattern == "iso8601":
        return lambda text: _seconds(datetime.fromisoformat(text))
    if pattern == "epoch":
        return lambda text: (float(text), False)
    probe = datetime(2001, 2, 3, 4, 5, 6, tzinfo=UTC)
    try:
        parsed = datetime.strptime(probe.strftime(pattern), pattern)  # noqa: DTZ007 - the zone is applied later
    except (ValueError, re.error):
        # A pattern that names the same part of a date twice becomes a regular expression that does so.
        parsed = None
    if parsed is None or parsed.date() != probe.date():
        raise SourceConfigError(
            f"timestamp format '{pattern}' is not usable; use 'iso8601', 'epoch' or a strptime pattern "
            "with year, month and day such as '%d.%m.%Y %H:%M:%S'"
        )
    directives, literals = _split(pattern)
    if "I" in directives and "p" not in directives:
        raise SourceConfigError(
            f"timestamp format '{pattern}' reads afternoons as mornings; use %H for hours from 0 to 23, or add %p "
            "where AM or PM is written"
        )
    in_utc = any(_UTC.search(literal) for literal in literals)

    def parse(text: str) -> tuple[float, bool]:
        moment = datetime.strptime(text, pattern)  # noqa: DTZ007
        # strptime reads the words and drops what they say.
        said = in_utc or ("Z" in directives and _UTC.search(text) is not None)
        return _seconds(moment.replace(tzinfo=UTC) if said and moment.tzinfo is None else moment)

    return parse


def _split(pattern: str) -> tuple[set[str], list[str]]:
    """The letters of the directives of a strptime pattern, and the literals after one of the time."""
    directives: set[str] = set()
    literals: list[str] = []
    for letter, literal in re.findall(r"%(.)([^%]*)", pattern, re.DOTALL):
        directives.add(letter)
        if directives & _OF_TIME:
            literals.append(literal)
    return directives, literals


def _seconds(moment: datetime) -> tuple[float, bool]:
    if moment.tzinfo is None:
        return (moment - _EPOCH).total_seconds(), True
    return moment.timestamp(), False


def time_zone(name: str) -> ZoneInfo:
    """The time zone called `name`; SourceConfigError if there is none."""
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):  # OSError: a name that is a folder of zones, such as "Europe"
        raise SourceConfigError(
            f"time zone '{name}' is unknown; use an IANA name such as 'Europe/Berlin' or 'UTC'"
        ) from None


def local_to_utc(local: Array, zone: ZoneInfo) -> Array:
    """UTC s of wall-clock seconds `local` (n,) in the order of the file, by which the two passes of the hour that
    autumn repeats are told apart (`_second_pass`); NaN for a time that spring skips."""
    hours, hour_of = np.unique(np.floor(local / 3600.0), return_inverse=True)
    utc = local - np.array([_steady_offset(zone, hour) for hour in hours], dtype=np.float64)[hour_of]
    changing = np.flatnonzero(np.isnan(utc))
    if changing.size:
        near = local[changing]
        first, second = (np.array([_offset(zone, time, fold) for time in near]) for fold in (0, 1))
        repeated = np.flatnonzero(first > second)
        backwards = bool(local[-1] < local[0])
        later = np.zeros(near.size, dtype=np.bool_)
        later[repeated] = _second_pass(local, changing[repeated], (first - second)[repeated], backwards)
        utc[changing] = near - np.where(later, second, first)
        utc[changing[first < second]] = np.nan
    return utc


def _steady_offset(zone: ZoneInfo, hour: float) -> float:
    """The UTC offset in s all through a wall-clock hour; NaN if it changes or is ambiguous anywhere in it."""
    offsets = {_offset(zone, hour * 3600.0 + within, fold) for within in (0.0, 3599.999999) for fold in (0, 1)}
    return offsets.pop() if len(offsets) == 1 else np.nan


def _offset(zone: ZoneInfo, local: float, fold: int) -> float:
    moment = (_EPOCH + timedelta(seconds=local)).replace(fold=fold, tzinfo=zone)
    return (moment.utcoffset() or timedelta(0)).total_seconds()


def _second_pass(local: Array, repeated: Indices, length: Array, backwards: bool) -> npt.NDArray[np.bool_]:
    """Which of the rows `repeated` (k,), whose wall-clock times the clock repeats for `length` (k,) s, belong to the
    second pass. It begins where local time steps back furthest, so that a record out of order does not pass for the
    clock change. Without a step back there was the first pass only, unless each has one record (`_one_each`). `local`
    (n,) are the wall-clock seconds of all rows; `backwards`: the file runs from new to old."""
    near = local[repeated]
    later = np.zeros(near.size, dtype=np.bool_)
    order = np.argsort(near, kind="stable")
    # Clock changes are months apart: times more than a day apart belong to different ones.
    change = np.empty(near.size, dtype=np.intp)
    change[order] = np.cumsum(np.diff(near[order], prepend=near[order[:1]]) > _DAY)
    for one in np.unique(change):
        rows = np.flatnonzero(change == one)
        if backwards:
            rows = rows[::-1]
        steps = np.diff(near[rows])
        if steps.size and steps.min() < 0:
            later[rows[steps.argmin() + 1 :]] = True
        elif rows.size == 2 and _one_each(local, repeated[rows], length[rows[0]]):
            later[rows[1]] = True
    return later


def _one_each(local: Array, pair: Indices, length: float) -> bool:
    """Whether the rows `pair` of a repeated stretch of `length` s are one record of either pass, at the same wall-clock
    time. Other records are then at least `length` s away, or a row was merely written twice; and their times differ, or
    every row was. Without other records neither can be told."""
    first, last = pair.min(), pair.max()
    sides = (local[max(first - 2, 0) : first], local[last + 1 : last + 3])
    return bool(
        local.size > 2
        and last - first == 1
        and local[first] == local[last]
        and all(np.unique(side).size == side.size and (abs(side - local[first]) >= length).all() for side in sides)
    )
