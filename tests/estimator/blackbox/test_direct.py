"""The direct regressions: what they find, what they trust, and that they never go beyond what was seen."""

import numpy as np
import pytest
from support.small_building import DAY, room

from estimator.network.presets import network
from estimator.registry import build

PERIOD = 1800.0
NETWORK = network("tite")


def make(**options):
    return build("direct", NETWORK, PERIOD, options)


@pytest.fixture
def estimator():
    return make()


def run(estimator, outputs, inputs, state=None, first=0, seen=lambda k, state: None):
    """The state after `outputs` (K,) under `inputs` (K, 2); `seen` is shown each predicted state."""
    if state is None:
        state = estimator.start(1, outputs[:1], inputs[0])
    for k in range(first, len(outputs) - 1):
        state = estimator.predict(state, inputs[k])
        seen(k, state)
        state = estimator.update(state, outputs[k + 1 : k + 2]).state
    return state


def errors_of(estimator, outputs, inputs, lead, after):
    """Errors of the forecasts `lead` steps ahead that were issued after the sample `after`, and of persistence."""
    own, held = [], []

    def look(k, state):
        if after <= k < len(outputs) - lead:
            fan = estimator.unfold(estimator.issue(state, 1), inputs[k + 1 : k + lead])
            own.append(outputs[k + lead] - fan.means[-1, 0, 0])
            held.append(outputs[k + lead] - outputs[k])

    run(estimator, outputs, inputs, seen=look)
    return np.array(own), np.array(held)


@pytest.mark.parametrize(("lead", "most"), [(1, 0.5), (12, 0.3), (DAY, 0.5)])
def test_what_the_inputs_explain_is_found_at_every_lead(lead, most):
    outputs, inputs = room(30 * DAY)
    own, held = errors_of(make(), outputs, inputs, lead, after=10 * DAY)
    assert np.sqrt(np.mean(own**2) / np.mean(held**2)) < most


def test_on_the_first_day_it_is_persistence(estimator):
    outputs, inputs = room(2 * DAY)
    for count in (2, DAY // 2, DAY):
        state = estimator.predict(run(estimator, outputs[:count], inputs), inputs[count - 1])
        fan = estimator.unfold(estimator.issue(state, 1), inputs[count : count + DAY])
        np.testing.assert_array_equal(fan.means[:, 0, 0], outputs[count - 1])


def test_a_room_with_a_set_back_is_foreseen_by_its_first_day():
    """The second day of a thermostat's, 6 h ahead, and how sure the forecast of a day ahead is of it."""
    hour = np.arange(2 * DAY) % DAY / 2.0
    outputs = 17.0 + 4.0 * ((hour > 6.0) & (hour < 22.0)) + 0.1 * np.random.default_rng(2).standard_normal(2 * DAY)
    inputs = np.zeros((2 * DAY, 2))
    estimator = make(blind=True)
    own, held = errors_of(estimator, outputs, inputs, 12, after=DAY)
    assert np.mean(np.abs(own)) < 0.7 * np.mean(np.abs(held))
    sds = estimator.issue(run(estimator, outputs, inputs), 1).sds[0]
    assert sds[-1] < 0.5 * sds.max()


def test_no_forecast_changes_by_more_than_was_ever_seen(estimator):
    outputs, inputs = room(12 * DAY)
    state = estimator.predict(run(estimator, outputs, inputs), inputs[-1])
    fan = estimator.unfold(estimator.issue(state, 1), np.tile([-60.0, 50_000.0], (DAY - 1, 1)))
    changes = fan.means[:, 0, 0] - outputs[-1]
    for lead in (1, 12, DAY):
        seen = outputs[lead:] - outputs[:-lead]
        assert min(0.0, seen.min()) - 1e-9 <= changes[lead - 1] <= max(0.0, seen.max()) + 1e-9


def test_a_regression_that_proves_worthless_is_not_believed():
    outputs, inputs = 20.0 + np.cumsum(0.1 * np.random.default_rng(4).standard_normal(40 * DAY)), room(40 * DAY)[1]
    own, held = errors_of(make(penalty_days=1e-3), outputs, inputs, 12, after=15 * DAY)
    assert np.mean(own**2) < 1.1 * np.mean(held**2)


@pytest.mark.parametrize("lead", [1, 12, DAY])
def test_the_spread_is_that_of_the_errors(lead, estimator):
    outputs, inputs = room(40 * DAY)
    own, _ = errors_of(estimator, outputs, inputs, lead, after=20 * DAY)
    state = estimator.predict(run(estimator, outputs, inputs), inputs[-1])
    fan = estimator.unfold(estimator.issue(state, 1), inputs[:DAY])
    assert fan.sds[lead - 1, 0, 0] == pytest.approx(np.sqrt(np.mean(own**2)), rel=0.3)


def test_forecasts_are_verified_with_the_coefficients_that_were_in_force():
    """The sums over verified forecasts, against forecasts that were issued and kept."""
    outputs, inputs = room(5 * DAY + 20)
    estimator, lead, squares, number = make(), 12, 0.0, 0.0
    leads = len(estimator.start(1, outputs[:1], inputs[0]).coefficients[0, 0])
    kept = []
    run(estimator, outputs, inputs, seen=lambda k, state: kept.append(estimator.issue(state, 1)))
    # Bounds and trust change with every sample; those of the regression alone are compared.
    free = {"trust": np.ones((1, leads)), "seen": np.tile([-99.0, 99.0], (1, leads, 1))}
    for k in range(len(outputs) - lead):
        fan = estimator.unfold(kept[k]._replace(**free), inputs[k + 1 : k + lead])
        share = estimator.verified_share(k + lead)
        squares, number = share * squares + (fan.means[-1, 0, 0] - outputs[k]) ** 2, share * number + 1.0
    verified = run(estimator, outputs, inputs).verified[0]
    place = np.flatnonzero(np.isclose(verified[:, 0], number, rtol=1e-9))
    assert squares > 1.0
    np.testing.assert_allclose(verified[place, 2], squares, rtol=0.05)


def test_beyond_a_day_the_forecast_of_the_first_is_the_past_of_the_second(estimator):
    outputs, inputs = room(20 * DAY)
    state = estimator.predict(run(estimator, outputs, inputs), inputs[-1])
    plan = room(3 * DAY, seed=5)[1]
    fan = estimator.unfold(estimator.issue(state, 1), plan)
    assert fan.means.shape == (3 * DAY + 1, 1, 1)
    np.testing.assert_array_equal(fan.means[:DAY], estimator.unfold(estimator.issue(state, 1), plan[: DAY - 1]).means)
    assert (np.diff(fan.sds[DAY:, 0, 0]) > 0.0).all()
    real = outputs[-1]
    for k in range(3 * DAY):
        real = 0.97 * real + 0.03 * (inputs[-1], *plan)[k][0] + 0.0015 * (inputs[-1], *plan)[k][1]
    assert fan.means[-2, 0, 0] == pytest.approx(real, abs=1.0)


def test_a_gap_leaves_the_regressions_and_forgets_the_hour(estimator):
    outputs, inputs = room(20 * DAY)
    state = run(estimator, outputs, inputs)
    after = estimator.restart(state, np.array([21.0]), inputs[0])
    assert np.abs(state.coefficients[..., 6:8]).max() > 0.0
    assert not after.coefficients[..., 6:8].any()
    assert not after.moments[:, :, 6:8].any()
    np.testing.assert_array_equal(after.coefficients[..., 8:], state.coefficients[..., 8:])
    assert after.measured.sum() == 1.0


def test_what_was_not_measured_is_not_learned_from():
    outputs, inputs = room(10 * DAY)
    outputs[3 * DAY : 5 * DAY] = np.nan
    known = np.isfinite(outputs)
    numbers = run(make(memory_days=1e6), outputs, inputs).moments[0, :, 0, 0]
    for lead in (1, 2, 12, DAY):
        assert np.isclose(numbers, (known[lead:] & known[:-lead]).sum(), rtol=1e-3).any()
    assert numbers[0] == pytest.approx(8 * DAY - 2, rel=1e-3)


def test_an_output_that_is_late_has_the_spread_of_a_longer_lead(estimator):
    outputs, inputs = room(10 * DAY)
    state = run(estimator, outputs, inputs)
    late = state
    for k in range(12):
        late = estimator.update(estimator.predict(late, inputs[k]), np.array([np.nan])).state
    at_once = estimator.unfold(estimator.issue(estimator.predict(state, inputs[0]), 1), inputs[1:12])
    assert estimator.predictive(late).sds[0, 0] == pytest.approx(at_once.sds[-1, 0, 0])


def test_a_blind_one_asks_for_no_input_to_come_and_foresees_what_goes_by_the_clock():
    outputs, inputs = room(30 * DAY)
    blind = make(blind=True)
    state = blind.predict(run(blind, outputs, inputs), inputs[-1])
    plans = (np.tile(row, (DAY - 1, 1)) for row in ([-60.0, 50_000.0], [30.0, 0.0]))
    first, second = (blind.unfold(blind.issue(state, 1), plan) for plan in plans)
    np.testing.assert_array_equal(first.means, second.means)
    own, held = errors_of(make(blind=True), outputs, inputs, 12, after=10 * DAY)
    knowing, _ = errors_of(make(), outputs, inputs, 12, after=10 * DAY)
    assert np.mean(knowing**2) < np.mean(own**2) < np.mean(held**2)
