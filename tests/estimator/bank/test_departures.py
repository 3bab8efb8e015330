"""A plan of heating is answered by what usually follows and by what physics says the plan changes about it."""

import numpy as np
import pytest

from estimator.bank.bank import answering_plan, by_physics
from estimator.bank.departures import as_usual, departure
from estimator.network.presets import network
from estimator.registry import build
from estimator.types import Mixtures

PERIOD, DAY = 1800.0, 48
NETWORK = network("tite")
USUAL = np.array([5.0, 300.0])


@pytest.fixture
def bank():
    members = {"ekf": {"estimator": "ekf"}, "blind": {"estimator": "direct", "blind": True}}
    return build("bank", NETWORK, PERIOD, {"members": members})


def played(bank, inputs, outputs):
    state = bank.start(1, outputs[:1], inputs[0])
    for row, y in zip(inputs, outputs[1:], strict=True):
        state = bank.update(bank.predict(state, row), np.array([y])).state
    return bank.predict(state, inputs[-1])


@pytest.fixture
def settled(bank):
    """After a day and a half in which a room stayed at 20 degC by more than the heat that is measured."""
    return played(bank, np.tile(USUAL, (72, 1)), 20.0 + 0.02 * np.random.default_rng(1).standard_normal(73))


def ends(bank, asked, heat):
    """Mean and standard deviation after a day of so much `heat`."""
    mean, sd = bank.unfold(asked, np.tile([5.0, heat], (DAY, 1))).moments()
    return mean[-1, 0], sd[-1, 0]


def test_in_the_first_days_the_usual_course_is_told_and_physics_what_a_plan_changes(bank, settled):
    asked, physics = answering_plan(bank, settled), by_physics(bank, settled)
    (usual, sure), (much, unsure) = (ends(bank, asked, heat) for heat in (300.0, 1500.0))
    assert abs(usual - 20.0) < 0.1 < abs(ends(bank, physics, 300.0)[0] - 20.0)
    assert much - usual == pytest.approx(ends(bank, physics, 1500.0)[0] - ends(bank, physics, 300.0)[0], rel=0.01)
    assert unsure > sure, "nobody has seen what so much heat does"
    assert bank.answering_plan(bank.start(1, np.array([20.0]), USUAL)).departs is False, "nothing is usual yet"


def test_what_is_usual_is_known_after_a_gap_that_ends_while_a_relay_is_on(bank, settled):
    on = np.array([5.0, 1500.0])
    state = bank.predict(bank.restart(settled, np.array([20.0]), on), on)
    assert abs(ends(bank, answering_plan(bank, state), 300.0)[0] - 20.0) < 0.8


def test_physics_that_has_proved_itself_answers_alone(bank):
    rng = np.random.default_rng(2)
    heat, air = 1500.0 * (rng.random(12 * DAY) < 0.3).repeat(2)[: 12 * DAY], [20.0]
    for power in heat:
        air.append(air[-1] + PERIOD / 5e6 * (power - 40.0 * (air[-1] - 5.0)))
    state = played(bank, np.column_stack([np.full(len(heat), 5.0), heat]), np.array(air))
    ekf, blind = state.answers.excess
    assert (blind[1:] - ekf[1:] > 20.0).all(), "of e-folds a tenth"
    assert ends(bank, answering_plan(bank, state), 0.0) == pytest.approx(ends(bank, by_physics(bank, state), 0.0))


def test_state_of_before_goes_on(bank, settled):
    arrays = {name: rows for name, rows in bank.pack(settled).items() if not name.startswith("answers.")}
    arrays["pending.inputs"] = arrays["pending.inputs"][-DAY + 1 :]
    resumed = bank.unpack(arrays)
    np.testing.assert_array_equal(resumed.answers.excess, settled.costs.excess)
    after = bank.update(resumed, np.array([20.0])).state
    assert ends(bank, answering_plan(bank, after), 300.0)[0] == pytest.approx(20.0, abs=0.2)


def test_a_departure_is_what_the_members_say_of_plan_and_usual_heating_and_as_unsure_as_they_differ():
    def gaussian(mean, sd):
        return Mixtures.of_gaussians(np.array([[mean], [2.0 * mean]]), np.full((2, 1), sd))

    planned, usual = ({0: gaussian(at, sd), 1: gaussian(3.0 * at, sd)} for at, sd in ((4.0, 0.5), (1.0, 0.3)))
    shares = np.array([[0.5, 1.0], [0.5, 0.0], [0.0, 0.0]])
    found = departure(planned, usual, shares)
    np.testing.assert_allclose(found.mean[:, 0], [6.0, 6.0])
    np.testing.assert_allclose(found.sd[:, 0], [np.sqrt(3.0**2 + 0.4**2), 0.4])
    told = found.of(gaussian(20.0, 0.3))
    np.testing.assert_allclose(told.moments()[0][:, 0], [26.0, 46.0])
    np.testing.assert_allclose(told.moments()[1][-1, 0], 0.5)


def test_usual_is_the_heating_of_the_day_before_and_its_mean_until_a_day_is_over():
    past = np.column_stack([np.full(2 * DAY, 5.0), np.arange(2.0 * DAY)])
    plan = np.tile([7.0, 300.0], (DAY + 2, 1))
    rows = as_usual(plan, past, [1], DAY, 1)
    assert rows[:, 1].tolist() == [*past[DAY:, 1], *past[DAY : DAY + 2, 1]]
    assert as_usual(plan, past, [1], DAY, 3)[1:-3, 1].tolist() == past[DAY + 1 : -1, 1].tolist()
    relay = np.where(np.arange(2 * DAY)[:, None] % 2, [5.0, 900.0], [5.0, 0.0])
    assert as_usual(plan, relay, [1], DAY, 2)[:, 1].tolist() == [450.0] * len(plan)
    assert (rows[:, 0] == 7.0).all(), "the weather is as planned"
    assert (as_usual(plan, past[:10], [1], DAY, 2)[:, 1] == 4.5).all()
