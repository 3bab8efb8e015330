"""Wall clocks: what a logger that knows no time zone writes down."""

from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import numpy as np
import numpy.typing as npt

Seconds = npt.NDArray[np.int64]

HOUR = 3600
DAY = 86_400


def midnight(year: int, month: int, day: int, zone: str) -> int:
    """UTC seconds since 1970 at the local midnight that begins this day in `zone` (an IANA name)."""
    return int(datetime(year, month, day, tzinfo=ZoneInfo(zone)).timestamp())


def wall_clock(times: Seconds, zone: str) -> Seconds:
    """Local wall-clock time at UTC seconds `times` (K,), as seconds since 1970-01-01 00:00 local.

    The hour that the autumn clock change repeats appears twice, as on the wall.
    """
    tz = ZoneInfo(zone)
    hours, inverse = np.unique(np.asarray(times) // HOUR, return_inverse=True)
    offsets = [datetime.fromtimestamp(int(hour) * HOUR, UTC).astimezone(tz).utcoffset() for hour in hours]
    seconds = np.array([0 if offset is None else int(offset.total_seconds()) for offset in offsets], dtype=np.int64)
    return np.asarray(times, dtype=np.int64) + seconds[inverse]


def weekday(local: Seconds) -> Seconds:
    """Day of the week of wall-clock seconds, 0 = Monday (1970-01-01 was a Thursday)."""
    return (local // DAY + 3) % 7


def clock_changes(times: Seconds, zone: str) -> Seconds:
    """UTC seconds of those `times` (ascending) at which the wall clock has just been moved."""
    offset = wall_clock(times, zone) - np.asarray(times)
    return np.asarray(times)[1:][np.diff(offset) != 0]
