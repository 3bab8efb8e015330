"""Times as people and programs write them: RFC 3339 with a zone, in UTC wherever Thermogate writes one."""

import math
from datetime import UTC, datetime


class ZoneMissing(ValueError):
    """A time that could be meant in any time zone."""


def parse_time(text: str) -> datetime:
    """The UTC time that `text` is in RFC 3339. ZoneMissing if it names no zone; another ValueError if it is no time."""
    time = datetime.fromisoformat(text)
    if time.tzinfo is None:
        raise ZoneMissing(text)
    try:
        return time.astimezone(UTC)
    except OverflowError:
        raise ValueError(text) from None


def utc(seconds: float) -> datetime:
    """`seconds` since 1970 as an aware UTC time; JSON shows it with Z."""
    return datetime.fromtimestamp(seconds, UTC)


def written_time(time: datetime | float) -> str:
    """`time` (if a number, UTC seconds) as RFC 3339 in UTC; a begun second is left out."""
    moment = time.astimezone(UTC) if isinstance(time, datetime) else utc(math.floor(time))
    return f"{moment:%Y-%m-%dT%H:%M:%SZ}"


def written_to_the_millisecond(seconds: float) -> str:
    return utc(seconds).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def written_day(time: datetime) -> str:
    return f"{time.astimezone(UTC):%Y-%m-%d}"
