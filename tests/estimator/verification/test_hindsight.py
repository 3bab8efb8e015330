"""Pending forecasts come true as what a forecast from their moment, under the inputs that followed, would have said."""

import numpy as np
import pytest
from support.forecasts import unfolded

from estimator.network.presets import network
from estimator.registry import build
from estimator.verification.hindsight import Hindsight

PERIOD = 1800.0
NETWORK = network("tite")
EKF = build("ekf", NETWORK, PERIOD, {})


def played(steps, hindsight, phase=0):
    """Pending forecasts after `steps`, the predicted states and inputs on the way."""
    rng = np.random.default_rng(2)
    inputs = [np.array([5.0 + np.sin(k / 9), 800.0 * (rng.random() < 0.5)]) for k in range(steps)]
    state, pending = EKF.start(1, np.array([20.0]), inputs[0]), hindsight.start()
    states, duties = [], []
    for k, given in enumerate(inputs, start=1):
        state = EKF.predict(state, given)
        states.append(state)
        pending = hindsight.advance(pending, given, [state], phase)
        duties.append((k, list(hindsight.due(pending)), pending))
        state = EKF.update(state, np.array([20.0 + 0.1 * rng.standard_normal()])).state
    return states, inputs, duties


def test_what_is_due_is_the_forecast_of_its_moment():
    hindsight = Hindsight(NETWORK, [EKF], PERIOD)
    assert hindsight.leads == (2, 12, 48)
    states, inputs, duties = played(70, hindsight)
    seen = {}
    for step, due, _ in duties:
        for one in due:
            issued = step - one.lead + 1
            *_, expected = unfolded(EKF, states[issued - 1], np.array(inputs[issued:step]))
            assert one.mixtures[0].mean()[0] == pytest.approx(expected.mean()[0], rel=1e-12)
            assert one.mixtures[0].sd()[0] == pytest.approx(expected.sd()[0], rel=1e-12)
            seen[one.lead] = seen.get(one.lead, 0) + 1
    assert seen == {2: 34, 12: 29, 48: 11}, "one an hour, as soon as there can be one"


@pytest.mark.parametrize("phase", [0, 1, 7])
def test_issues_keep_to_their_phase(phase):
    _, _, duties = played(30, Hindsight(NETWORK, [EKF], PERIOD), phase)
    issued = {issue.step for issue in duties[-1][2].issues}
    assert issued
    assert {step % 2 for step in issued} == {phase % 2}


def test_what_waits_is_bounded():
    _, _, duties = played(200, Hindsight(NETWORK, [EKF], PERIOD))
    pending = duties[-1][2]
    assert len(pending.issues) <= 24
    assert len(pending.inputs) < 48


def test_a_period_of_more_than_an_hour_has_no_horizon_below_it():
    hindsight = Hindsight(NETWORK, [build("ekf", NETWORK, 7200.0, {})], 7200.0)
    pending = hindsight.advance(hindsight.start(), np.zeros(2), [EKF.start(1, np.array([20.0]), np.zeros(2))], 0)
    assert not list(hindsight.due(pending))
