"""Local time, weekends and public holidays of a site, for what people do every day at the same hours."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from functools import lru_cache

import numpy as np

from adapters.holidays import public_holidays
from adapters.timestamps import time_zone
from estimator.arrays import HOUR, Array
from estimator.heat.known import Calendar, LocalTime
from estimator.heat.sun import Location
from estimator.thermostat.futures import KindOfDay, Offsets

_NOWHERE: frozenset[object] = frozenset()
_SATURDAY = 5


def calendar(name: str | None, country: str | None, location: Location | None) -> Calendar:
    """Local time in the time zone `name`, or by the sun at the `location` in whole hours from UTC, and public holidays
    of `country`, such as "DE" or "DE-BW"; ValueError with one sentence for a country that nobody knows."""
    zone: tzinfo
    if name is not None:
        zone = time_zone(name)
    else:
        zone = timezone(timedelta(hours=0 if location is None else round(location.longitude / 15.0)))
    holidays = _NOWHERE if country is None else public_holidays(country)

    def local(times: Array) -> LocalTime:
        found = [datetime.fromtimestamp(time, UTC).astimezone(zone) for time in times.tolist()]
        saving = [(when.dst() or timedelta()).total_seconds() / 3600.0 for when in found]
        hours = np.array([when.hour + when.minute / 60.0 + when.second / 3600.0 for when in found])
        off = [when.weekday() >= _SATURDAY or when.date() in holidays for when in found]
        return LocalTime(hours, (hours - np.array(saving)) % 24.0, np.array(off, dtype=np.float64))

    return local


def kinds_of_day(local: Calendar) -> KindOfDay:
    """1 on weekends and public holidays of `local` time, 0 otherwise; to the hour."""
    off = _by_the_hour(lambda times: local(times).off)
    return lambda times: off(times).astype(np.int64)


def offsets(local: Calendar) -> Offsets:
    """How far clocks of `local` time are ahead of UTC, -12 to 12 h; to the hour."""
    return _by_the_hour(lambda times: np.rint(((local(times).hour - times / HOUR + 12.0) % 24.0 - 12.0) * HOUR))


def _by_the_hour(told: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """`told` at the beginning of the hour of each of the times that it is asked for [UTC s]."""

    @lru_cache(maxsize=4096)
    def of_hour(hour: float) -> float:
        return float(told(np.array([hour * HOUR]))[0])

    def values(times: Array) -> Array:
        hours, place = np.unique(times // HOUR, return_inverse=True)
        return np.array([of_hour(hour) for hour in hours.tolist()])[place]

    return values
