from itertools import product

import numpy as np
import pytest

from replay.scores.learning import area_under_roc, parasitic_learning_index, update_magnitudes
from replay.scores.residuals import residual_autocorrelation

NAN = np.nan


def test_update_magnitude_is_the_length_of_the_step_in_log_parameters() -> None:
    theta = np.exp([[0.0, 0.0, 5.0], [3.0, 4.0, 5.0], [3.0, 4.0, 5.0]])
    np.testing.assert_allclose(update_magnitudes(theta), [NAN, 5.0, 0.0], atol=1e-15)


def test_index_is_the_ratio_of_the_medians() -> None:
    magnitudes = np.array([NAN, 1.0, 2.0, 30.0, 8.0, 4.0, 6.0])
    dominated = np.array([False, False, False, False, True, True, True])
    assert parasitic_learning_index(magnitudes, dominated) == pytest.approx(6.0 / 2.0)
    assert np.isnan(parasitic_learning_index(magnitudes, np.zeros(7, dtype=bool)))
    assert np.isfinite(parasitic_learning_index(np.array([0.0, 1.0]), np.array([False, True])))


@pytest.mark.parametrize("seed", range(5))
def test_area_under_roc_counts_the_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    score = rng.integers(0, 6, 40).astype(float)  # many ties
    label = rng.random(40) < 0.3
    pairs = list(product(score[label], score[~label]))
    counted = sum(1.0 if high > low else 0.5 if high == low else 0.0 for high, low in pairs) / len(pairs)
    assert area_under_roc(score, label) == pytest.approx(counted, rel=1e-12)


def test_autocorrelation_of_a_sine_follows_its_cosine() -> None:
    count, cycle, lags = 60_000, 60, 30
    residual = np.sin(2 * np.pi * np.arange(count) / cycle)
    expected = sum(np.cos(2 * np.pi * lag / cycle) ** 2 for lag in range(1, lags + 1))
    # the biased estimate loses a share lag / count at each lag
    assert residual_autocorrelation(residual, lags) == pytest.approx(expected, rel=2 * lags / count)
    later = sum(np.cos(2 * np.pi * lag / cycle) ** 2 for lag in range(10, lags + 1))
    assert residual_autocorrelation(residual, lags, first=10) == pytest.approx(later, rel=2 * lags / count)


def test_correlations_by_hand_with_a_missing_row() -> None:
    residual = np.array([1.0, -1.0, 1.0, -1.0, NAN])
    # complete products at lag 1: three of -1, over four rows
    assert residual_autocorrelation(residual, 1) == pytest.approx((3 / 4) ** 2)
    assert np.isnan(residual_autocorrelation(np.ones(10), 3))
    assert np.isnan(residual_autocorrelation(residual, 5))
