"""Volatility (21), the learning gate and the regimes of paper 3.4.4."""

import numpy as np
import pytest

from estimator.kernels.draws import Draws
from estimator.network.presets import network
from estimator.particle.gate import learning_gate, regime, weighted_quantiles
from estimator.particle.options import resolve
from estimator.particle.volatility import propagate_volatility

PAPER = resolve(network("building-67"), 600.0, {"preset": "paper"})


def options(**given):
    return resolve(network("building-67"), 600.0, {"preset": "paper"} | given)


def test_the_walk_has_its_standard_deviation_and_no_drift():
    count = 200_000
    walked = propagate_volatility(np.zeros((1, count)), PAPER, Draws(1, 1))
    assert walked.std() == pytest.approx(0.1, abs=5 * 0.1 / np.sqrt(2 * count))
    assert walked.mean() == pytest.approx(0.0, abs=5 * 0.1 / np.sqrt(count))


def test_alpha_stays_inside_its_bounds():
    walked = propagate_volatility(np.zeros((1, 1000)), options(volatility_sd=10.0), Draws(1, 1))
    assert walked.min() == pytest.approx(np.log(0.01))
    assert walked.max() == pytest.approx(np.log(25.0))


def test_jumps_come_as_often_and_as_far_as_told():
    count, jumpy = 100_000, options(jump_probability=0.02, jump_sd=1.5, volatility_sd=1e-9)
    moved = propagate_volatility(np.zeros((1, count)), jumpy, Draws(1, 1))[0]
    jumped = np.abs(moved) > 1e-6
    assert jumped.mean() == pytest.approx(0.02, abs=5 * np.sqrt(0.02 / count))
    assert moved[jumped].std() == pytest.approx(1.5, abs=5 * 1.5 / np.sqrt(2 * 0.02 * count))


def test_weighted_quantiles_are_the_smallest_values_that_reach_the_level():
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([0.2, 0.5, 0.3])
    np.testing.assert_array_equal(
        weighted_quantiles(values, weights, np.array([0.1, 0.5, 0.51, 0.8, 0.81, 1.0])), [1, 1, 2, 2, 3, 3]
    )


def test_the_first_median_is_counted_on_top_of_the_pseudo_counts():
    histogram = np.ones(30)
    low, high = np.log(0.01), np.log(25.0)
    first = learning_gate(histogram, low + 0.5 * (high - low) / 30, PAPER)
    assert first.cdf == pytest.approx(2 / 31)
    assert first.gate == 1.0
    assert first.histogram[0] == 2
    assert histogram[0] == 1, "the running histogram that was passed in is not changed"


@pytest.mark.parametrize("end", ["alpha_min", "alpha_max"])
def test_a_median_at_the_edge_of_the_range_falls_into_the_outermost_bin(end):
    counted = learning_gate(np.ones(30), float(np.log(getattr(PAPER, end))), PAPER)
    assert counted.histogram[0 if end == "alpha_min" else -1] == 2


def test_the_gate_ramps_from_one_to_its_minimum():
    low, high = np.log(0.01), np.log(25.0)
    gates, cdfs = [], []
    for index in range(30):
        result = learning_gate(np.ones(30), low + (index + 0.5) * (high - low) / 30, PAPER)
        gates.append(result.gate)
        cdfs.append(result.cdf)
        if result.cdf <= 0.40:
            assert result.gate == 1.0
        elif result.cdf >= 0.95:
            assert result.gate == 0.05
        else:
            assert result.gate == pytest.approx(0.05 + 0.95 * (0.95 - result.cdf) / 0.55)
    assert gates == sorted(gates, reverse=True)
    assert cdfs[-1] == 1.0
    assert gates[0] == 1.0
    assert gates[-1] == 0.05


def test_regimes():
    assert [regime(cdf, PAPER) for cdf in (0.0, 0.4, 0.41, 0.94, 0.95, 1.0)] == [
        "low", "low", "transitional", "transitional", "high", "high",
    ]  # fmt: skip
