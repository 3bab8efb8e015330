import numpy as np
import pytest

from replay.scores.intervals import interval_scores, pit_histogram, rmse, winkler

NAN = np.nan
# inside, on the bound, below by .5, above by .25, three incomplete rows
Y = np.array([20.0, 21.0, 19.5, 22.25, NAN, 20.0, 20.0])
LOWER = np.array([19.0, 20.0, 20.0, 21.0, 19.0, NAN, 19.0])
UPPER = np.array([21.0, 21.0, 22.0, 22.0, 21.0, 21.0, NAN])


def test_rmse_by_hand() -> None:
    assert rmse(np.array([3.0, NAN, -4.0])) == pytest.approx(np.sqrt(12.5))


def test_winkler_by_hand() -> None:
    # widths 2, 1, 2, 1; the penalty factor is 2 / .05 = 40
    assert winkler(Y, LOWER, UPPER, 0.95) == pytest.approx((2 + 1 + (2 + 40 * 0.5) + (1 + 40 * 0.25)) / 4)
    assert winkler(Y, LOWER, UPPER, 0.5) == pytest.approx((2 + 1 + (2 + 4 * 0.5) + (1 + 4 * 0.25)) / 4)


def test_winkler_is_smallest_at_the_true_quantiles() -> None:
    y = np.random.default_rng(1).standard_normal(200_000)
    scores = {half: winkler(y, np.full_like(y, -half), np.full_like(y, half), 0.95) for half in (1.7, 1.96, 2.2)}
    assert min(scores, key=lambda half: scores[half]) == 1.96


def test_interval_scores_are_those_of_the_complete_rows() -> None:
    scores = interval_scores(Y, LOWER, UPPER, 0.95)
    assert scores.samples == 4
    assert (scores.coverage, scores.width) == (0.5, 1.5)
    assert scores.winkler == pytest.approx(9.0)


def test_pit_histogram_counts_shares() -> None:
    assert pit_histogram(np.array([0.0, 0.1, 0.6, 1.0, NAN]), bins=2).tolist() == [0.5, 0.5]
    uniform = pit_histogram(np.random.default_rng(2).random(100_000), bins=10)
    np.testing.assert_allclose(uniform, 0.1, atol=5 * np.sqrt(0.1 * 0.9 / 100_000))
    assert np.isnan(pit_histogram(np.array([NAN]), bins=3)).all()
