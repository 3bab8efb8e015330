"""What a zone begins with where others have learned: populations of parameters, sums of regressions, weights."""

import numpy as np
import pytest

from estimator.neighbours import DAYS, Learned, begun, experience
from estimator.network.boxes import boxed
from estimator.network.presets import network
from estimator.registry import build
from estimator.verification.scores import crps

PERIOD, DAILY = 1800.0, 48
NETWORK = boxed(network("tite"))
HEAT, START = 1200.0, 7 * 3600.0


def house(steps, begin=0.0, loss=60.0, seed=0):
    """Outputs (steps,) and inputs (steps, n_u) of one capacitance, heated from 6 to 18 h, from `begin` [s] on."""
    rng, room, outputs, inputs = np.random.default_rng(seed), 19.0, [], []
    for k in range(steps):
        hour = (begin + k * PERIOD) / 3600.0 % 24.0
        row = np.array([5.0 + 3.0 * np.sin(2.0 * np.pi * (hour - 9.0) / 24.0), HEAT * (6.0 <= hour < 18.0)])
        outputs.append(room + 0.02 * rng.standard_normal())
        inputs.append(row)
        room += PERIOD / 6e6 * (row[1] - loss * (room - row[0]))
    return np.array(outputs), np.array(inputs)


def learned(name, options=None, days=10, begin=0.0, known=None, **of):
    """What an estimator knows after `days` from `begin` on, and the score of its last forecast of six hours [K]."""
    estimator = build(name, NETWORK, PERIOD, options or {})
    outputs, inputs = house(int(days * DAILY) + 12, begin, **of)
    state = begun(estimator, estimator.start(1, outputs[:1], inputs[0]), begin, known)
    for k in range(1, int(days * DAILY)):
        state = estimator.update(estimator.predict(state, inputs[k - 1]), outputs[k : k + 1]).state
    k = max(1, int(days * DAILY))
    state = estimator.predict(state, inputs[k - 1])
    fan = estimator.unfold(estimator.issue(state, 100), inputs[k : k + 11])
    return Learned(estimator, state, begin + k * PERIOD), crps(fan.at(11), 0, outputs[k + 11])


SMALL = {"mkf": {"particles": 40, "preset": "habits-slow"}}
BANK = {"members": {"ekf": {"estimator": "ekf"}, "arx": {"estimator": "arx"}, "direct": {"estimator": "direct"}}}


@pytest.mark.parametrize("name", ["ekf", "ukf", "mkf"])
def test_parameters_begin_among_the_neighbours_and_not_as_sure_as_they_are(name):
    others = [learned(name, SMALL.get(name), begin=day * 86400.0, seed=day)[0] for day in range(3)]
    estimator = build(name, NETWORK, PERIOD, SMALL.get(name, {}))
    levels = np.array([0.025, 0.5, 0.975])
    state = estimator.start(1, np.array([19.0]), np.array([5.0, 0.0]))
    informed = begun(estimator, state, 0.0, experience(estimator, others))
    low, middle, high = estimator.parameters(informed, levels).heat_loss
    alone = estimator.parameters(state, levels).heat_loss
    theirs = [other.estimator.parameters(other.state, levels).heat_loss for other in others]
    assert abs(np.log(middle / 60.0)) < abs(np.log(alone[1] / 60.0))
    assert max(high / low for low, _, high in theirs) < high / low < alone[2] / alone[0]


def test_who_knows_nothing_teaches_nothing():
    estimator = build("ekf", NETWORK, PERIOD, {})
    state = estimator.start(1, np.array([19.0]), np.array([5.0, 0.0]))
    informed = begun(estimator, state, 0.0, experience(estimator, [Learned(estimator, state, 0.0)]))
    for own, same in zip(state, informed, strict=True):
        np.testing.assert_allclose(same, own, rtol=1e-9, atol=1e-12)
    assert experience(estimator, []) == {}
    assert begun(estimator, state, 0.0, None) is state


@pytest.mark.parametrize("name", ["arx", "daily", "direct"])
def test_a_regression_forecasts_its_first_day_as_its_neighbours_taught_it(name):
    # It begins at another hour than they did, and reads the same clock.
    others = [learned(name, begin=day * 86400.0, days=14, seed=day)[0] for day in range(2)]
    known = experience(others[0].estimator, others)
    begins = np.arange(5, 15) * 86400.0 + START
    taught = np.mean([learned(name, begin=begin, days=0.25, known=known, seed=9)[1] for begin in begins])
    alone = np.mean([learned(name, begin=begin, days=0.25, seed=9)[1] for begin in begins])
    assert taught < 0.7 * alone


def test_other_channels_and_periods_teach_a_regression_nothing():
    others = [learned("direct", days=3)[0]]
    assert experience(build("direct", NETWORK, 900.0, {}), others) == {}
    assert experience(build("direct", network("ecolar-6r4c"), PERIOD, {}), others) == {}
    assert experience(build("arx", NETWORK, PERIOD, {}), others) == {}


def test_a_bank_begins_with_what_the_members_proved_elsewhere_for_some_days():
    other = learned("bank", BANK)[0]
    other = other._replace(state=other.state._replace(answers=other.state.costs))
    estimator = other.estimator
    known = experience(estimator, [other])
    state = begun(estimator, estimator.start(1, np.array([19.0]), np.array([5.0, 0.0])), 0.0, known)
    theirs, own = estimator.member_weights(other.state), estimator.member_weights(state)
    first = estimator.member_weights(estimator.start(1, np.array([19.0]), np.array([5.0, 0.0])))
    for name in estimator.names:
        # Between where it began and where they are.
        assert ((own[name] - first[name]) * (theirs[name] - first[name]) >= -1e-3).all(), name
    assert state.costs.hours.max() <= 24.0 * DAYS
    assert np.array_equal(state.answers.excess, state.costs.excess)
    assert state.widths.log_scale == pytest.approx(other.state.widths.log_scale)
    assert np.array_equal(estimator.unpack(estimator.pack(state)).costs.excess, state.costs.excess)


def test_a_room_unlike_its_neighbours_forgets_them():
    # Next door twice the heat keeps a room six times as leaky.
    others = [learned("bank", BANK, days=14, loss=300.0, seed=day)[0] for day in range(2)]
    known = experience(others[0].estimator, others)
    taught, alone = (
        np.mean([learned("bank", BANK, days=days, begin=START, known=given, seed=9)[1] for days in (7.0, 8.3, 9.6)])
        for given in (known, None)
    )
    assert taught < 1.3 * alone + 0.02
