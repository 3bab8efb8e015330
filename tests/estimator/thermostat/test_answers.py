"""What futures that run the thermostat answer."""

import numpy as np
import pytest

from estimator.thermostat.answers import Amounts, below, difference, energy, latest, probability_reached
from estimator.thermostat.live import Heat
from estimator.types import Mixtures

HALVES = np.array([0, 0, 1, 1])


def futures(count=3):
    """Heat (N, 4, 1) of N futures: 1, 2, ... kW all the time."""
    return np.arange(1.0, count + 1.0)[:, None, None] * np.full((1, 4, 1), 1000.0)


def heat(values):
    """All futures weigh the same, and have the weather that is foreseen."""
    count, steps, _ = values.shape
    return Heat(values, np.full((steps, count), 1.0 / count), np.full(count, -1))


def test_energy_is_power_times_time_with_cooling_counted():
    amounts = energy(heat(futures() * np.array([1.0, -1.0, 1.0])[:, None, None]), 1800.0, HALVES)
    assert amounts.values.tolist() == [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]
    assert amounts.mean() == pytest.approx([2.0, 2.0])


def test_a_price_below_zero_is_earned():
    paid = energy(heat(-futures()), 1800.0, HALVES, np.array([0.5, 0.5, -0.1, -0.1]))
    assert paid.values[:, 0].tolist() == [0.5, 1.0, 1.5]
    assert paid.values[:, 1] == pytest.approx([-0.1, -0.2, -0.3])


def test_spans_weigh_their_own_futures():
    weights = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    amounts = energy(heat(futures())._replace(weights=weights), 1800.0, HALVES)
    assert amounts.mean().tolist() == [1.0, 3.0]
    assert amounts.quantiles(np.array([0.025, 0.5, 0.975])).tolist() == [[1.0] * 3, [3.0] * 3]
    changing = futures() * np.array([1.0, 1.0, 0.0, 1.0])[:, None]
    assert energy(heat(changing)._replace(weights=weights), 1800.0).mean().tolist() == [2.5], "not 3"


def test_quantiles_are_those_of_a_large_sample():
    rng = np.random.default_rng(1)
    count = 20_000
    amounts = Amounts(rng.standard_normal((count, 1)), np.full((count, 1), 1.0 / count), np.full(count, -1))
    found = amounts.quantiles(np.array([0.025, 0.5, 0.975]))[0]
    # Standard errors of the quantiles of a normal sample: sqrt(p (1 - p) / n) over the density there.
    assert found == pytest.approx([-1.96, 0.0, 1.96], abs=4 * 0.0189)


def test_stretched_amounts_keep_their_mean():
    amounts = Amounts(np.array([[1.0], [2.0], [6.0]]), np.array([[0.5], [0.25], [0.25]]), np.full(3, -1))
    assert amounts.stretched(np.array([0.5])).values[:, 0].tolist() == [1.75, 2.25, 4.25]
    assert amounts.stretched(np.array([3.0])).values[:, 0].tolist() == [-2.0, 1.0, 13.0]


def test_what_two_plans_have_in_common_cancels_out():
    rng = np.random.default_rng(2)
    shared = 5.0 * rng.standard_normal((500, 1))
    weights = np.full((500, 1), 1 / 500)
    warm, cool = (Amounts(shared + k, weights, np.full(500, -1)) for k in (10.0, 9.0 + 0.01 * rng.random((500, 1))))
    found, levels = difference(warm, cool), np.array([0.025, 0.975])
    low, high = found.quantiles(levels)[0]
    assert 0.99 <= low <= high <= 1.0
    spread = np.std(found.stretched(found.unsure()).values)
    assert spread == pytest.approx(0.25 * found.mean()[0], rel=0.01), "all models may err by a quarter"


def test_hours_below_a_set_point_leave_out_steps_without_one():
    temperatures = np.array([[20.0, 19.0, 19.0, 18.0], [21.0, 21.0, 21.0, 21.0]])
    amounts = below(temperatures, np.array([20.0, 20.0, np.nan, 20.0]), np.full((4, 2), 0.5), 1800.0, 0.5)
    assert amounts.values.ravel().tolist() == [1.0, 0.0]
    assert amounts.mean() == pytest.approx([0.5])


def test_a_future_that_swings_reaches_its_highest_temperature():
    means = np.array([[[20.0, 22.0, 19.0]], [[21.5, 20.0, 19.5]], [[20.0, 22.0, 19.0]]])
    futures = Mixtures(np.tile([0.5, 0.25, 0.25], (3, 1)), means, np.full((3, 1, 3), 1e-6))
    still = np.zeros((1, 3))
    assert probability_reached(futures, 21.0, still) == 0.75
    assert probability_reached(futures.during(slice(2, 3)), 21.0, still[:, :1]) == 0.25
    assert probability_reached(futures, 22.0, still) == pytest.approx(0.125)


def test_futures_that_differ_by_a_swing_alone_all_reach_the_top_of_it():
    """Half of them 0.4 K below, half above, for two hours, where the room was seen to go up and down by as much."""
    futures = Mixtures(np.full((4, 2), 0.5), np.tile([19.6, 20.4], (4, 1))[:, None], np.full((4, 1, 2), 1e-6))
    swings = np.array([[0.4, -0.4, 0.4, -0.4], [-0.4, 0.4, -0.4, 0.4]])
    assert probability_reached(futures, 20.2, np.zeros((1, 4))) == 0.5
    assert probability_reached(futures, 20.2, swings) == 1.0
    assert probability_reached(futures.during(slice(3, 4)), 20.2, swings[:, 3:]) == 0.5, "too short for a swing"
    assert probability_reached(futures, 20.6, swings) == 0.0


@pytest.mark.parametrize(("enough", "expected"), [(10, 10), (7, 7), (0, 0), (-1, None)])
def test_the_latest_start_is_found_in_few_questions(enough, expected):
    asked = []

    def reached(step):
        asked.append(step)
        return 0.95 if step <= enough else 0.5

    assert latest(reached, 10, 0.9) == expected
    assert len(asked) <= 6
