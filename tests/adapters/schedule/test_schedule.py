"""A weekly schedule: what it has when, how it is written, and that forecasts know it."""

from contextlib import aclosing
from datetime import datetime

import numpy as np
import pytest

from adapters.schedule.config import ScheduleConfig
from adapters.schedule.source import ScheduleSource
from service.config.load import load

DAYS = [
    {"on": ["mon", "tue", "wed", "thu", "fri"], "at": {"06:30": 21.0, "22:00": 17.0}},
    {"on": ["sat", "sun", "holiday"], "at": {"09:00": 20.0, "23:00": 16.0}},
]
TABLE = {"kind": "schedule", "time_zone": "Europe/Berlin", "country": "DE-BW", "days": DAYS}


def table(**changes):
    return ScheduleConfig(**(TABLE | changes))


def week():
    return table().channel(source="hours").within(table()).week


@pytest.mark.parametrize(
    ("time", "value"),
    [
        ("2025-03-24T06:29:00+01:00", 16.0),  # Monday morning: still as on Sunday evening
        ("2025-03-24T06:30:00+01:00", 21.0),
        ("2025-03-25T02:00:00+01:00", 17.0),
        ("2025-03-29T10:00:00+01:00", 20.0),
        ("2025-03-31T06:30:00+02:00", 21.0),  # the first morning of summer time
        ("2025-01-06T08:00:00+01:00", 16.0),  # Epiphany, a Monday, which not all of Germany keeps
        ("2025-01-06T09:00:00+01:00", 20.0),
    ],
)
def test_a_value_holds_from_its_time_of_day_until_the_next(time, value):
    assert week().at(datetime.fromisoformat(time).timestamp()) == value


async def test_the_source_delivers_what_the_schedule_has_now():
    source = table().build("hours", [])
    assert isinstance(source, ScheduleSource)
    async with aclosing(source.batches(None)) as stream:
        assert (await anext(stream)).readings == []
    assert source.check() == []


async def test_a_zone_takes_its_set_points_from_it(tmp_path):
    (tmp_path / "site.toml").write_text(
        """
[site]
id = "home"
state_dir = "state"

[sources.posted]
kind = "http"

[sources.hours]
kind = "schedule"
time_zone = "Europe/Berlin"
days = [{ on = ["mon", "tue", "wed", "thu", "fri", "sat", "sun"], at = { "06:00" = 70.0, "22:00" = 62.0 } }]

[[zones]]
id = "room"
period = "15min"
network = "tite"
setpoint = { source = "hours", unit = "degF" }

[zones.channels]
T_i = { source = "posted", unit = "degC" }
T_out = { source = "posted", unit = "degC" }
u_heat = { source = "posted", unit = "W" }
"""
    )
    config = load(tmp_path / "site.toml")
    (zone,) = config.zones
    times = np.array([datetime.fromisoformat(f"2025-07-01T{hour}:00+02:00").timestamp() for hour in ("05:59", "06:00")])
    assert zone.setpoint.foreknown(times) == pytest.approx([50 / 3, 190 / 9])

    async with aclosing(config.build_source("hours").batches(None)) as stream:
        ((channel, _, value, *_),) = (await anext(stream)).readings
    assert channel == "room/setpoint"
    assert value in (pytest.approx(50 / 3), pytest.approx(190 / 9))
