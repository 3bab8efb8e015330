"""How wide the published interval is made: by what held, and while little is known by how far off forecasts were."""

import numpy as np
import pytest
from scipy.special import ndtr

from estimator.bank.coverage import no_widths, with_place

LEVELS = {"level": 0.95, "feedback": 0.02, "first": 1.0}


def learned(true_sd, count, share=1.0, seed=1, **changed):
    """The scale after `count` forecasts N(0, 1) of what is N(0, true_sd^2)."""
    widths = no_widths(2)
    for value in true_sd * np.random.default_rng(seed).standard_normal(count):
        place = float(ndtr(value / np.exp(widths.log_scale[1])))
        widths = with_place(widths, 1, place, share, **LEVELS | changed)
    assert widths.log_scale[0] == widths.verified[0] == 0.0, "the other horizon has learned nothing"
    assert widths.verified[1] == count
    return float(np.exp(widths.log_scale[1]))


@pytest.mark.parametrize("true_sd", [0.2, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_spread_is_found_within_some_hundred_forecasts(true_sd, seed):
    assert learned(true_sd, 300, seed=seed) == pytest.approx(true_sd, rel=0.3)


def test_whether_intervals_held_does_not_tell_as_soon():
    told_by_both, told_by_intervals = learned(0.2, 100), learned(0.2, 100, share=0.0)
    assert told_by_both < 0.35 < 0.6 < told_by_intervals


def test_forecasts_that_overlap_count_less():
    assert learned(0.2, 50) < learned(0.2, 50, share=1 / 6) < learned(0.2, 50, share=1 / 24) < 1.0


@pytest.mark.parametrize("place", [0.0, 1.0])
def test_what_was_impossible_widens_by_a_bounded_step(place):
    widths = with_place(no_widths(1), 0, place, 1.0, **LEVELS)
    assert 0.95 < widths.log_scale[0] < 1.5


def test_in_the_long_run_the_interval_holds_as_often_as_it_claims_whatever_the_distribution():
    widths, held, values = no_widths(1), [], np.random.default_rng(2).laplace(size=20_000) ** 3
    for value in values:
        place = float(ndtr(value / np.exp(widths.log_scale[0])))
        held.append(abs(place - 0.5) <= 0.475)
        widths = with_place(widths, 0, place, 1.0, **LEVELS)
    assert np.mean(held[1000:]) == pytest.approx(0.95, abs=0.005)
