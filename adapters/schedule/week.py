"""A week of values in local time: what each day of the week has, and public holidays."""

from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, timedelta, tzinfo

import numpy as np

from adapters.timestamps import Array

HOLIDAY = "holiday"
WEEKDAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")


@dataclass(frozen=True)
class Week:
    """Values that change at times of day, by the day of the week. A value holds until the next one, over midnight."""

    changes: Mapping[str, Mapping[float, float]]
    """Of each of WEEKDAYS, and of HOLIDAY if holidays differ: values by the hour from which they hold, ascending."""
    zone: tzinfo
    holidays: Container[object] = field(default=(), repr=False)
    """Dates that have the values of HOLIDAY; a calendar shows the years it was asked for, which are no part of repr."""

    def at(self, time: float) -> float:
        """The value at UTC s `time`."""
        now = datetime.fromtimestamp(time, UTC).astimezone(self.zone)
        hour = now.hour + now.minute / 60.0 + now.second / 3600.0
        today = [value for since, value in self._day(now.date()).items() if since <= hour]
        return today[-1] if today else list(self._day(now.date() - timedelta(days=1)).values())[-1]

    def values(self, times: Array) -> Array:
        """(h,): the values at `times` (h,) [UTC s]."""
        return np.array([self.at(time) for time in times.tolist()])

    def _day(self, day: date) -> Mapping[float, float]:
        off = HOLIDAY in self.changes and day in self.holidays
        return self.changes[HOLIDAY if off else WEEKDAYS[day.weekday()]]
