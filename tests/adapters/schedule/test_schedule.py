"""A weekly schedule: what it has when, how it is written, and that forecasts know it."""

import asyncio
from datetime import datetime

import numpy as np
import pytest
from support import sites
from support.tables import tabled

from adapters.schedule.config import ScheduleConfig
from service.config.load import load
from service.recordings.samples import read_samples

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


def test_a_schedule_is_no_measurement(tmp_path):
    zone = sites.recorded("room")
    zone["channels"]["T_out"] = {"source": "hours", "unit": "degC"}
    log = sites.recording(tmp_path / "log.csv", ["room"], 3, 600, (50, 5))
    (warning,) = load(sites.written(tmp_path, {"log": log, "hours": TABLE}, [zone])).warnings
    assert "T_out: has the values of the schedule hours, which are planned, not measured" in warning


def test_a_recorded_zone_takes_its_set_points_from_it(tmp_path):
    every = {"on": ["mon", "tue", "wed", "thu", "fri", "sat", "sun"], "at": {"06:05": 70.0, "22:00": 62.0}}
    hours = {"kind": "schedule", "time_zone": "Europe/Berlin", "days": [every]}
    zone = sites.recorded("room", period="10min", setpoint={"source": "hours", "unit": "degF"})
    log = sites.recording(tmp_path / "log.csv", ["room"], 144, 600, (50, 5))
    config = load(sites.written(tmp_path, {"log": log, "hours": hours}, [zone]))
    (zone,) = config.zones
    assert not config.goes_live(zone)
    night, day = 50 / 3, 190 / 9
    (probe,) = asyncio.run(config.build_source("hours").probe(1.0))
    assert probe.value in (pytest.approx(night), pytest.approx(day))
    begin = datetime.fromisoformat("2025-05-03T06:00+02:00").timestamp()
    assert zone.setpoint.foreknown("degC")(begin + np.array([240.0, 300.0])) == pytest.approx([night, day])
    found = {sample.time: sample for sample in read_samples(config, [zone])["room"].samples}
    assert len(found) == 144
    setpoints = [found[begin + 600 * step].setpoint for step in (-1, 0, 1)]
    assert setpoints == pytest.approx([night, (night + day) / 2, day])
    assert any(np.isnan(sample.outputs[0]) for sample in found.values())
    assert all(np.isfinite(sample.setpoint) for sample in found.values())
