"""Forecasts of a zone with a thermostat: plans of set-points, of heat, and none."""

from functools import cache

import numpy as np
import pytest
from support.forecasts import asked, fan_of, question
from support.thermostat_house import morning, samples
from support.zone_samples import fed, worker

from estimator.thermostat.futures import NOTHING_KNOWN
from service.errors import NoLaw
from service.forecast.engine import PartQuestion
from service.forecast.plan import Timed
from service.records.outlook import SET_POINTS

PERIOD = 1800
DAILY = 48


def worker_after(days, **known):
    return fed(worker("ekf", "tite", PERIOD, known=known), samples(days, PERIOD))


@cache
def lived():
    """A zone after six days, at midnight."""
    return worker_after(6)


def mean(zone, planned=None, steps=DAILY):
    return fan_of(zone, steps, planned or {}).outputs[0].mean


def origin(zone, planned=None):
    return dict(zip(zone.network.inputs, fan_of(zone, 4, planned or {}).origins, strict=True))["u_heat"].origin


def test_a_plan_of_set_points_is_kept_by_the_thermostat():
    warm, cold = (mean(lived(), {SET_POINTS: value}) for value in (21.0, 16.0))
    assert np.abs(warm[24:] - 21.0).max() < 0.8
    assert warm[-1] - cold[-1] > 3.0
    assert origin(lived(), {SET_POINTS: 21.0}) == origin(lived()) == "thermostat"


def test_a_schedule_is_followed_although_no_day_before_was_like_it():
    def schedule(times):
        return np.array([morning(time / 3600.0) if time < 3 * 86400.0 else 16.0 for time in times.tolist()])

    assert mean(worker_after(3, to_come=NOTHING_KNOWN._replace(schedule=schedule)))[24:].max() < 18.0


def test_a_plan_in_watts_is_answered_in_watts():
    assert mean(lived(), {"u_heat": 0.0})[-1] < 15.0
    assert origin(lived(), {"u_heat": 0.0}) == "plan"
    # Who plans both means the watts: the set-point then has nothing that obeys it.
    with pytest.raises(NoLaw, match=r"T_set and the heat that obeys it \(u_heat\) are both planned; plan one of them"):
        mean(lived(), {"u_heat": 0.0, SET_POINTS: 21.0})


def test_set_points_that_begin_later_are_the_likely_ones_before():
    late = Timed(np.array([lived().latest.forecast.valid_time + 12 * 3600.0]), np.array([25.0]))
    plain, planned = mean(lived()), mean(lived(), {SET_POINTS: late})
    assert np.abs(planned[:20] - plain[:20]).max() < 0.7
    assert planned[-1] > 23.0


def test_a_neighbour_sees_the_room_as_its_thermostat_keeps_it():
    def room(planned):
        part = asked(lived(), PartQuestion(question(DAILY, planned)))
        for inputs in part.outlook.rows:
            part.room.step(inputs)
        return part.room.outputs()[0]

    assert abs(room({SET_POINTS: 21.0}) - 21.0) < 0.8
    assert room({"u_heat": 0.0}) < 15.0
