"""Local time, weekends and public holidays of a site, for what people do every day at the same hours."""

from __future__ import annotations

import importlib
from collections.abc import Container
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from functools import lru_cache

import numpy as np

from adapters.timestamps import time_zone
from estimator.arrays import Array
from estimator.heat.known import Calendar, LocalTime
from estimator.heat.sun import Location

_NOWHERE: frozenset[object] = frozenset()
_SATURDAY = 5


def calendar(name: str | None, country: str | None, location: Location | None) -> Calendar:
    """Local time in the time zone `name` and the public holidays of `country`, such as "DE" or "DE-BW".

    Without a time zone the hours are those of the sun at the `location`, in whole hours from UTC. ValueError with one
    sentence for a country that nobody knows.
    """
    zone = _zone(name, location)
    holidays = _NOWHERE if country is None else _holidays(country)

    def local(times: Array) -> LocalTime:
        found = [datetime.fromtimestamp(time, UTC).astimezone(zone) for time in times.tolist()]
        saving = [(when.dst() or timedelta()).total_seconds() / 3600.0 for when in found]
        hours = np.array([when.hour + when.minute / 60.0 + when.second / 3600.0 for when in found])
        off = [when.weekday() >= _SATURDAY or when.date() in holidays for when in found]
        return LocalTime(hours, (hours - np.array(saving)) % 24.0, np.array(off, dtype=np.float64))

    return local


def check_country(country: str) -> None:
    """ValueError with one sentence if the public holidays of `country` are not known."""
    _holidays(country)


def _zone(name: str | None, location: Location | None) -> tzinfo:
    if name is not None:
        return time_zone(name)
    return timezone(timedelta(hours=0 if location is None else round(location.longitude / 15.0)))


@lru_cache(maxsize=16)
def _holidays(country: str) -> Container[object]:
    try:
        package = importlib.import_module("holidays")
    except ImportError:
        raise ValueError(
            "needs the package holidays, which has the public holidays of most countries; install it with "
            "pip install 'thermogate[holidays]', or remove country: weekends are known without it"
        ) from None
    code, _, part = country.partition("-")
    try:
        found: Container[object] = package.country_holidays(code, subdiv=part or None)
    except NotImplementedError:
        raise ValueError(f'"{country}" is not a country that it knows; use a code such as "DE", or "DE-BW"') from None
    return found
