"""Moments and quantiles of many mixtures at once are those of each, found one by one."""

import numpy as np
import pytest
from scipy.stats import norm
from support.forecasts import mixture_quantile

from estimator.types import Mixture, Mixtures
from estimator.verification.scores import reduced
from estimator.verification.summaries import as_distributed, summary

LEVELS = np.array([0.5, 0.025, 0.975])


def mixtures(times, outputs, count):
    rng = np.random.default_rng(count)
    weights = rng.uniform(0.0, 1.0, (times, count))
    shape = (times, outputs, count)
    return Mixtures(weights, 20.0 + 2.0 * rng.standard_normal(shape), rng.uniform(0.1, 1.0, shape))


@pytest.mark.parametrize(("outputs", "count"), [(1, 8), (2, 8), (1, 200), (3, 200)])
def test_each_time_is_told_by_itself(outputs, count):
    whole = mixtures(5, outputs, count)
    told = summary(whole, LEVELS, True)
    for time, mixture in enumerate(whole.each()):
        own = mixture._replace(weights=mixture.weights / mixture.weights.sum())
        np.testing.assert_allclose(told.means[time], own.mean(), rtol=1e-12)
        np.testing.assert_allclose(told.sds[time], own.sd(), rtol=1e-12)
        for output in range(outputs):
            expected = [mixture_quantile(level, own.weights, own.means[output], own.sds[output]) for level in LEVELS]
            np.testing.assert_allclose(told.quantiles[time, output], expected, atol=1e-9)


def test_components_that_stand_for_others_have_nearly_the_same_tails():
    """Of components with one mean the wide ones make the tails: they must not be merged with the narrow ones."""
    rng = np.random.default_rng(3)
    sds = np.exp(rng.normal(0.0, 0.4, (1, 1, 3000)))
    whole = Mixtures(np.full((1, 3000), 1.0 / 3000), 20.0 + 0.1 * rng.standard_normal((1, 1, 3000)), sds)
    exact, few = (summary(whole, LEVELS, one) for one in (True, False))
    by_mean = summary(Mixtures.of_one(reduced(whole.at(0), 96)), LEVELS, True)
    error, of_mean = (np.abs(one.quantiles - exact.quantiles).max() for one in (few, by_mean))
    assert 0.0 < error < 0.5 * of_mean


def test_a_gaussian_has_its_own_quantiles():
    told = summary(Mixtures.of_gaussians(np.array([[20.0], [21.0]]), np.array([[0.5], [1.0]])), LEVELS, True)
    np.testing.assert_allclose(told.quantiles[1, 0], norm.ppf(LEVELS, 21.0, 1.0), rtol=1e-12)


@pytest.mark.parametrize(("first", "later"), [(3, 5), (5, 3), (4, 4)])
def test_what_fills_up_weighs_nothing(first, later):
    now, rest = mixtures(1, 2, first).at(0), mixtures(4, 2, later)
    whole = rest.after(now)
    assert whole.means.shape == (5, 2, max(first, later))
    told = summary(whole, LEVELS, True)
    for time, mixture in enumerate([now, *rest.each()]):
        for of_whole, of_one in zip(told, summary(Mixtures.of_one(mixture), LEVELS, True), strict=True):
            np.testing.assert_allclose(of_whole[time], of_one[0], rtol=1e-10)
    assert isinstance(whole.at(0), Mixture)


def test_paths_keep_their_places_and_get_the_distribution_of_each_time():
    rng, whole = np.random.default_rng(5), mixtures(6, 2, 12)
    paths = 20.0 + rng.standard_normal((200, 6, 2)).cumsum(axis=1)
    found = as_distributed(paths, whole)
    for time in range(6):
        for output in range(2):
            own, before = found[:, time, output], paths[:, time, output]
            assert np.array_equal(np.argsort(own), np.argsort(before)), "who was lowest is lowest"
    told = summary(whole, LEVELS, True)
    np.testing.assert_allclose(np.median(found, axis=0), told.quantiles[:, :, 0], atol=0.05)
    np.testing.assert_allclose(found.mean(axis=0), told.means, atol=0.02)
    np.testing.assert_allclose(found.std(axis=0), told.sds, rtol=0.05)
