"""The black boxes: what they learn of signals that are known, and how sure they are of it."""

import numpy as np
import pytest
from support.forecasts import unfolded
from support.small_building import DAY, room

from estimator.network.presets import network
from estimator.registry import build
from estimator.verification.scores import crps

PERIOD = 1800.0
NETWORK = network("tite")


def run(estimator, outputs, inputs, verify=()):
    """The state after `outputs` (K,) under `inputs` (K, 2), told of the errors at the leads `verify`."""
    state, pending = estimator.start(1, outputs[:1], inputs[0]), []
    for k in range(len(outputs) - 1):
        state = estimator.predict(state, inputs[k])
        for lead in verify:
            if k + lead < len(outputs):
                *_, last = unfolded(estimator, state, inputs[k + 1 : k + lead])
                pending.append((k + lead, lead, last.mean()))
        state = estimator.update(state, outputs[k + 1 : k + 2]).state
        for due, lead, mean in [one for one in pending if one[0] == k + 1]:
            state = estimator.verified(state, lead, outputs[due : due + 1] - mean)
        pending = [one for one in pending if one[0] > k + 1]
    return state


def test_a_regression_is_found():
    outputs, inputs = room(1500)
    arx = build("arx", NETWORK, PERIOD, {"past_outputs": 1, "past_inputs": 1})
    state = run(arx, outputs, inputs)
    np.testing.assert_allclose(state.coefficients[0, 1], 0.97, atol=0.01)
    np.testing.assert_allclose(state.coefficients[0, 3], 1.5, atol=0.05)
    assert arx.predictive(arx.predict(state, inputs[-1])).sd()[0] == pytest.approx(0.02, rel=0.2)


@pytest.mark.parametrize("name", ["arx", "daily"])
def test_a_forecast_is_what_predicting_step_by_step_gives(name):
    outputs, inputs = room(200)
    estimator = build(name, NETWORK, PERIOD, {})
    state = estimator.predict(run(estimator, outputs, inputs), inputs[-1])
    plan = room(2 * DAY + 9, seed=5)[1]
    fan, step = unfolded(estimator, state, plan), state
    for ahead, given in enumerate(plan, start=1):
        step = estimator.predict(step, given)
        assert fan[ahead].mean()[0] == pytest.approx(estimator.predictive(step).mean()[0], rel=1e-12)


def test_what_every_day_repeats_is_forecast_without_a_cause():
    days = 12
    hour = np.arange(days * DAY) % DAY
    rng = np.random.default_rng(2)
    outputs = 20.0 + 2.0 * (hour > 16) - 1.0 * (hour > 34) + 0.02 * rng.standard_normal(days * DAY)
    inputs = np.tile([5.0, 0.0], (len(outputs), 1))
    daily, arx = build("daily", NETWORK, PERIOD, {}), build("arx", NETWORK, PERIOD, {})
    cut = 10 * DAY + 10
    errors = {}
    for estimator in (daily, arx):
        state = estimator.predict(run(estimator, outputs[: cut + 1], inputs), inputs[0])
        fan = unfolded(estimator, state, inputs[:30])
        errors[estimator] = np.sqrt(
            np.mean([(m.mean()[0] - y) ** 2 for m, y in zip(fan, outputs[cut + 1 :], strict=False)])
        )
    assert errors[daily] < 0.1
    assert errors[arx] > 3 * errors[daily]


@pytest.mark.parametrize("name", ["arx", "daily"])
def test_the_spread_hours_ahead_is_what_forecasts_have_missed_by(name):
    # Disturbances that last for hours: errors grow faster than independent residuals would have it.
    outputs, inputs = room(1500)
    slow, rng = np.zeros(len(outputs)), np.random.default_rng(8)
    for k in range(1, len(slow)):
        slow[k] = 0.99 * slow[k - 1] + 0.1 * rng.standard_normal()
    outputs = outputs + slow
    estimator = build(name, NETWORK, PERIOD, {})
    state = run(estimator, outputs, inputs, verify=(2, 12))
    *_, far = unfolded(estimator, estimator.predict(state, inputs[0]), inputs[:11])
    arx = state if name == "arx" else state.differences()
    place = np.flatnonzero(arx.leads == 12)[0]
    missed = np.sqrt(arx.errors[place, 0, 0] / arx.errors[place, 0, 1])
    assert far.sd()[0] == pytest.approx(missed, rel=0.1)


@pytest.mark.parametrize("hours", [0.5, 1, 6])
def test_verified_errors_are_forgotten_by_the_day(hours):
    arx = build("arx", NETWORK, 3600.0 * hours, {"verified_memory_days": 5.0})
    state = arx.start(1, np.array([20.0]), np.array([5.0, 0.0]))
    for _ in range(int(100 * 24 / max(1, hours))):
        state = arx.verified(state, 4, np.array([0.1]))
    a_day = 24 / max(1, hours)
    assert state.errors[0, 0, 1] == pytest.approx(5.0 * a_day, rel=0.05), "as many as five days bring"


@pytest.mark.parametrize("name", ["arx", "daily"])
def test_a_sensor_that_stands_still_leaves_a_spread(name):
    estimator = build(name, NETWORK, 86400.0, {"memory_days": 0.1})
    state = run(estimator, np.full(120, 20.0), np.tile([5.0, 0.0], (120, 1)))
    forecast = estimator.predictive(estimator.predict(state, np.array([5.0, 0.0])))
    assert 0.0 < forecast.sd()[0] < 0.01
    assert crps(forecast, 0, 20.1) == pytest.approx(0.1, rel=0.1)


def test_an_unstable_regression_stays_near_what_was_measured():
    outputs, inputs = 20.0 * 1.02 ** np.arange(30), np.tile([5.0, 0.0], (30, 1))
    arx = build("arx", NETWORK, PERIOD, {})
    *_, far = unfolded(arx, arx.predict(run(arx, outputs, inputs), inputs[0]), np.tile(inputs[:1], (500, 1)))
    assert abs(far.mean()[0] - outputs[-1]) < 20.0
    assert np.isfinite(far.sd()).all()
