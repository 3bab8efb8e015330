"""Scores of forecasts: against their definition, and against what is known in closed form."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from estimator.types import Mixture
from estimator.verification.scores import crps, distribution, gaussian_crps, reduced


def by_definition(mixture, value):
    """The integral of (F(x) - 1{x >= value})^2 over x, on a fine grid."""
    grid = np.linspace(mixture.means.min() - 12, mixture.means.max() + 12, 100_001)
    cdf = sum(
        w * norm.cdf(grid, m, s) for w, m, s in zip(mixture.weights, mixture.means[0], mixture.sds[0], strict=True)
    )
    return np.trapezoid((cdf - (grid >= value)) ** 2, grid)


@pytest.mark.parametrize("value", [17.0, 20.3, 21.0, 26.0])
def test_the_score_of_a_mixture_is_its_definition(value):
    mixture = Mixture(np.array([0.2, 0.5, 0.3]), np.array([[20.0, 21.0, 22.5]]), np.array([[0.3, 0.1, 1.0]]))
    assert crps(mixture, 0, value) == pytest.approx(by_definition(mixture, value), abs=2e-4)


@pytest.mark.parametrize("value", [19.0, 20.0, 20.7])
def test_one_gaussian_has_the_closed_form(value):
    mixture = Mixture(np.ones(1), np.array([[20.0]]), np.array([[0.5]]))
    assert crps(mixture, 0, value) == pytest.approx(float(gaussian_crps(np.array([20.0]), np.array([0.5]), value)[0]))


def test_a_sure_forecast_costs_its_absolute_error():
    assert crps(Mixture(np.ones(1), np.array([[20.0]]), np.array([[1e-9]])), 0, 21.5) == pytest.approx(1.5)


def test_a_reduced_mixture_keeps_mean_spread_and_score():
    rng = np.random.default_rng(4)
    count = 1000
    weights = rng.gamma(0.3, size=count)
    large = Mixture(weights / weights.sum(), 20 + rng.standard_normal((1, count)), np.full((1, count), 0.1))
    small = reduced(large)
    assert len(small.weights) <= 32
    assert small.mean()[0] == pytest.approx(large.mean()[0], rel=1e-9)
    assert small.sd()[0] == pytest.approx(large.sd()[0], rel=1e-9)
    assert crps(small, 0, 20.8) == pytest.approx(by_definition(large, 20.8), rel=0.01)
    assert reduced(small) is small


def test_a_reduced_mixture_keeps_the_moments_of_every_output():
    rng = np.random.default_rng(5)
    means = np.array([20.0 + rng.standard_normal(300), 5.0 + 2.0 * rng.standard_normal(300)])
    large = Mixture(rng.dirichlet(np.ones(300)), means, rng.uniform(0.1, 0.3, (2, 300)))
    small = reduced(large, 10)
    np.testing.assert_allclose(small.mean(), large.mean(), rtol=1e-9)
    np.testing.assert_allclose(small.sd(), large.sd(), rtol=1e-9)


def test_the_distribution_of_a_mixture_is_that_of_its_parts():
    mixture = Mixture(np.array([0.4, 1.2]), np.array([[20.0, 21.0]]), np.array([[0.5, 0.5]]))
    expected = 0.25 * norm.cdf(20.4, 20.0, 0.5) + 0.75 * norm.cdf(20.4, 21.0, 0.5)
    assert distribution(mixture, 0, 20.4) == pytest.approx(expected, rel=1e-12)


def test_a_score_is_finite_far_away():
    assert math.isfinite(crps(Mixture(np.ones(1), np.array([[20.0]]), np.array([[0.01]])), 0, 1e6))
