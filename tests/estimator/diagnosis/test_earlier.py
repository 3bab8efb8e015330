"""What was learned of telemetry that lied is given up, and what was learned of a new truth is kept."""

import numpy as np
import pytest
from support.thermostat_house import recorded

from estimator.diagnosis.finding import SENSOR_JUMPED, UNIT_CHANGED
from estimator.diagnosis.telemetry.earlier import Earlier, before_lies, kept
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
    lying = lost[CLEAN : CLEAN + LYING]
    assert lying.max() > 1.3 * truth[CLEAN], "the lie misleads until it is found"
    assert carried.suspicions == ()
    assert lost[-DAY:] == pytest.approx(truth[-DAY:], rel=0.05)


def test_a_new_sensor_is_learned_and_kept():
    """What stood for a week is the truth of now, whatever was thought of it."""
    ago = [Earlier(float(day * 86400), day, None) for day in (1, 3)]
    stood = [Suspicion(SENSOR_JUMPED, 0, 2.0 * 86400)]
    assert before_lies(ago, stood, [], 8.5 * 86400).state == 1
    assert before_lies(ago, stood, [], 9.5 * 86400) is None
    assert before_lies(ago, stood, stood, 8.5 * 86400) is None
    other = Suspicion(UNIT_CHANGED, 1, 3.5 * 86400)
    assert before_lies(ago, stood, [*stood, other], 4.0 * 86400).state == 3


def test_nothing_to_go_back_to_and_nothing_older_than_the_lie():
    suspicion = [Suspicion(SENSOR_JUMPED, 0, 0.5 * 86400)]
    assert before_lies((), [], suspicion, 86400.0) is None
    young = (Earlier(86400.0, "young", None),)
    assert before_lies(young, [], suspicion, 86400.0).state == "young"


def test_two_are_kept_two_days_apart():
    earlier = ()
    for hour in range(240):
        earlier = kept(earlier, hour * 3600.0, hour, None)
    assert [one.state for one in earlier] == [144, 192]
