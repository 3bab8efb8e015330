"""What was learned of telemetry that lied is given up, and what was learned of a new truth is kept."""

import numpy as np
import pytest
from support.tables import tabled
from support.thermostat_house import recorded

from estimator.diagnosis.finding import SENSOR_JUMPED, UNIT_CHANGED
from estimator.diagnosis.telemetry.earlier import Earlier, differ, doubtful_since, keeps, kept, known_at
from estimator.diagnosis.telemetry.lies import Suspicion
from estimator.loop import Loop
from estimator.network.presets import network
from estimator.registry import build

PERIOD = 1800
DAY = 86400 // PERIOD
CLEAN, LYING, AFTER = 9 * DAY, 2 * DAY, 2 * DAY


def learned(told):
    """(lost, carried): the heat loss [W/K] known after every sample, where a meter of heat tells `told` times the truth
    for the lying days."""
    outputs, inputs, _ = recorded((CLEAN + LYING + AFTER) // DAY, PERIOD)
    inputs[CLEAN : CLEAN + LYING, 1] *= told
    loop = Loop(build("ekf", network("tite"), PERIOD, {}), 5, (0.95,))
    carried, lost = loop.begin(), []
    for k, (y, row) in enumerate(zip(outputs, inputs, strict=True)):
        carried = loop.step(carried, k * PERIOD, y, row, k > 0).carried
        lost.append(float(loop.estimator.parameters(carried.standing.state, np.array([0.5])).heat_loss[0]))
    return np.array(lost), carried


def test_what_was_learned_of_a_lie_is_given_up_when_it_ends():
    truth, _ = learned(1.0)
    lost, carried = learned(1000.0)
    assert lost[CLEAN : CLEAN + LYING].max() > 1.3 * truth[CLEAN], "the lie misleads until it is found"
    assert carried.suspicions == ()
    assert lost[-DAY:] == pytest.approx(truth[-DAY:], rel=0.05)


def test_forecasts_are_verified_again_after_what_was_learned_was_given_up():
    outputs, inputs, _ = recorded((CLEAN + LYING + AFTER) // DAY, PERIOD)
    inputs[CLEAN : CLEAN + LYING, 1] *= 1000.0
    members = {"one": {"estimator": "ekf"}, "other": {"estimator": "arx"}}
    loop = Loop(build("bank", network("tite"), PERIOD, {"members": members}), 5, (0.95,))
    carried, gone_back = loop.begin(), 0
    for k, (y, row) in enumerate(zip(outputs, inputs, strict=True)):
        before = carried.suspicions
        carried = loop.step(carried, k * PERIOD, y, row, k > 0).carried
        gone_back += before != carried.suspicions
    assert gone_back
    last = loop.verification.scores(carried.standing.verified, (len(outputs) - 1) * PERIOD, 1)
    assert (last.forecasts[1:3] >= 18.0).all()


DAYS = 86400.0
STOOD = Suspicion(SENSOR_JUMPED, 0, 2.0 * DAYS)
OTHER = Suspicion(UNIT_CHANGED, 1, 3.5 * DAYS)


@tabled
def test_nothing_is_believed_while_something_is_suspected(before, now, day, since):
    before, now = ([{"stood": STOOD, "other": OTHER}[name] for name in names] for names in (before, now))
    assert doubtful_since(before, now, day * DAYS) == (None if since is None else since * DAYS)


def test_a_zone_goes_back_when_a_suspicion_begins_or_ends_and_not_while_it_stands():
    assert not differ([STOOD], [STOOD._replace(since=3.0 * DAYS)])
    assert not differ([], [])
    assert differ([], [STOOD])
    assert differ([STOOD, OTHER], [STOOD])


def test_what_was_known_before_the_lie_or_as_long_ago_as_possible():
    ago = (Earlier(1.0 * DAYS, "old", None), Earlier(3.0 * DAYS, "young", None))
    assert [known_at(ago, day * DAYS).state for day in (0.5, 2.0, 3.5)] == ["old", "old", "young"]
    assert known_at((), DAYS) is None


def test_two_are_kept_two_days_apart():
    earlier = ()
    for hour in range(240):
        if keeps(earlier, hour * 3600.0):
            earlier = kept(earlier, Earlier(hour * 3600.0, hour, None))
    assert [one.state for one in earlier] == [144, 192]
