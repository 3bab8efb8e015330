"""Times that a payload carries, as UTC seconds."""

import math
from datetime import datetime
from zoneinfo import ZoneInfo

from adapters.fields.numbers import float_in

TIME_FORMATS = ("iso8601", "epoch", "epoch_ms")


class NaiveTime(ValueError):
    """A time without offset, and no time zone to take it for."""


def parse_time(value: object, form: str, zone: ZoneInfo | None, near: float) -> float:
    """UTC s of `value`, written as `form` (one of TIME_FORMATS). A time without offset is in `zone`, in the hour that
    comes twice the one nearer to `near` (UTC s). Raises ValueError with one sentence, NaiveTime without a zone."""
    if form == "iso8601":
        if not isinstance(value, str):
            raise ValueError(f'has the time {value!r}, which is no text; set time_format to "epoch" or "epoch_ms"')
        return _from_text(value, zone, near)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError("has a time that is no number")
    try:
        number = float_in(value) if isinstance(value, str) else float(value)
        seconds = number / (1000.0 if form == "epoch_ms" else 1.0)
    except (ValueError, OverflowError):
        raise ValueError(f"has the time {value!r}, which is no number; look at time_format") from None
    if not math.isfinite(seconds):
        raise ValueError("has a time that is not finite")
    return seconds


def _from_text(text: str, zone: ZoneInfo | None, near: float) -> float:
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        raise ValueError(f'has the time "{text}", which is not a time such as "2026-01-15T12:00:00Z"') from None
    if moment.tzinfo is not None:
        return moment.timestamp()
    if zone is None:
        raise NaiveTime(f'has the time "{text}" without offset; give time_zone')
    try:
        return _local(moment, zone, near)
    except OverflowError:
        raise ValueError(f'has the time "{text}", which is out of this world') from None


def _local(moment: datetime, zone: ZoneInfo, near: float) -> float:
    passes = [moment.replace(tzinfo=zone, fold=fold).timestamp() for fold in (0, 1)]
    there = [time for time in passes if datetime.fromtimestamp(time, zone).replace(tzinfo=None) == moment]
    if not there:
        raise ValueError(f"has the time {moment}, which is in the hour that spring skips")
    return min(there, key=lambda time: abs(time - near))
