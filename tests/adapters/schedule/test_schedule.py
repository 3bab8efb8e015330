"""A weekly schedule: what it has when, how it is written, and that forecasts know it."""

from contextlib import aclosing
from datetime import datetime

import numpy as np
import pytest
from support import sites
from support.tables import tabled

from adapters.schedule.config import ScheduleConfig
from service.config.load import load

DAYS = [
    {"on": ["mon", "tue", "wed", "thu", "fri"], "at": {"06:30": 21.0, "22:00": 17.0}},
    {"on": ["sat", "sun", "holiday"], "at": {"09:00": 20.0, "23:00": 16.0}},
]
TABLE = {"kind": "schedule", "time_zone": "Europe/Berlin", "country": "DE-BW", "days": DAYS}


def week():
    table = ScheduleConfig(**TABLE)
    return table.channel(source="hours").within(table).week


@tabled
def test_a_value_holds_from_its_time_of_day_until_the_next(time, value):
    assert week().at(datetime.fromisoformat(time).timestamp()) == value


async def test_a_zone_takes_its_set_points_from_it(tmp_path):
    every = {"on": ["mon", "tue", "wed", "thu", "fri", "sat", "sun"], "at": {"06:00": 70.0, "22:00": 62.0}}
    hours = {"kind": "schedule", "time_zone": "Europe/Berlin", "days": [every]}
    zone = sites.zone("room", "posted", {}, setpoint={"source": "hours", "unit": "degF"})
    config = load(sites.written(tmp_path, {"posted": {"kind": "http"}, "hours": hours}, [zone]))
    (zone,) = config.zones
    times = np.array([datetime.fromisoformat(f"2025-07-01T{hour}:00+02:00").timestamp() for hour in ("05:59", "06:00")])
    assert zone.setpoint.foreknown(times) == pytest.approx([50 / 3, 190 / 9])
    async with aclosing(config.build_source("hours").batches(None)) as stream:
        ((channel, _, value, *_),) = (await anext(stream)).readings
    assert channel == "room/setpoint"
    assert value in (pytest.approx(50 / 3), pytest.approx(190 / 9))
