"""Local hours, daylight saving time, weekends and public holidays."""

import sys
from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from adapters.holidays import public_holidays
from estimator.heat.sun import Location
from service.zone.local_time import calendar, offsets

BERLIN = ZoneInfo("Europe/Berlin")


def at(*when):
    return datetime(*when, tzinfo=BERLIN).timestamp()


def test_hours_are_those_of_the_clock_and_the_sun_keeps_standard_time():
    local = calendar("Europe/Berlin", None, None)
    found = local(np.array([at(2025, 1, 15, 7, 30), at(2025, 7, 15, 7, 30)]))
    np.testing.assert_allclose(found.hour, [7.5, 7.5])
    np.testing.assert_allclose(found.standard_hour, [7.5, 6.5])
    assert offsets(local)(np.array([at(2025, 1, 15, 7, 30), at(2025, 7, 15, 7, 30)])).tolist() == [3600.0, 7200.0]


def test_weekends_and_holidays_are_days_off():
    days = np.array([at(2025, 10, 2, 12), at(2025, 10, 3, 12), at(2025, 10, 4, 12), at(2025, 6, 19, 12)])
    assert calendar("Europe/Berlin", None, None)(days).off.tolist() == [0, 0, 1, 0]
    assert calendar("Europe/Berlin", "DE", None)(days).off.tolist() == [0, 1, 1, 0]
    # Corpus Christi is one in Baden-Wuerttemberg.
    assert calendar("Europe/Berlin", "DE-BW", None)(days).off.tolist() == [0, 1, 1, 1]


def test_without_a_time_zone_the_sun_tells_the_hour():
    noon = np.array([datetime(2025, 1, 15, 12, tzinfo=ZoneInfo("UTC")).timestamp()])
    assert calendar(None, None, None)(noon).hour.tolist() == [12.0]
    assert calendar(None, None, Location(40.0, -105.2))(noon).hour.tolist() == [5.0]


def test_a_package_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "holidays", None)
    with pytest.raises(ValueError, match=r"install it with pip install 'thermogate\[holidays\]', or remove country"):
        public_holidays("SE")
