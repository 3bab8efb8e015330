"""How wide the published interval is made: by what held, and while little is known by how far off forecasts were."""

import numpy as np
import pytest
from scipy.special import ndtr

from estimator.bank.coverage import no_widths, with_place

LEVELS = {"level": 0.95, "feedback": 0.02, "first": 1.0}


@pytest.mark.parametrize("place", [0.0, 1.0])
def test_what_was_impossible_widens_by_a_bounded_step(place):
    assert 0.95 < with_place(no_widths(1), 0, place, 1.0, **LEVELS).log_scale[0] < 1.5


def test_in_the_long_run_the_interval_holds_as_often_as_it_claims_whatever_the_distribution():
    widths, held, values = no_widths(1), [], np.random.default_rng(2).laplace(size=20_000) ** 3
    for value in values:
        place = float(ndtr(value / np.exp(widths.log_scale[0])))
        held.append(abs(place - 0.5) <= 0.475)
        widths = with_place(widths, 0, place, 1.0, **LEVELS)
    assert np.mean(held[1000:]) == pytest.approx(0.95, abs=0.005)


def test_forecasts_that_miss_one_event_together_widen_as_one_forecast_does():
    settled = LEVELS | {"first": 0.0}
    once, together = with_place(no_widths(1), 0, 1.0, 1.0, **settled), no_widths(1)
    for _ in range(24):
        together = with_place(together, 0, 1.0, 1.0 / 24.0, **settled)
    assert together.log_scale[0] == pytest.approx(once.log_scale[0], rel=0.05)


def test_a_forecast_that_stands_for_those_of_a_day_is_learned_from_as_they_are():
    def place(widths, deviate):
        # Forecasts are half as wide as they should be.
        return float(ndtr(2.0 * deviate / np.exp(widths.log_scale[0])))

    seldom = often = no_widths(1)
    for deviate in np.random.default_rng(3).normal(size=300):
        seldom = with_place(seldom, 0, place(seldom, deviate), 1.0, **LEVELS, stands=24.0)
        for _ in range(24):
            often = with_place(often, 0, place(often, deviate), 1.0 / 24.0, **LEVELS)
    assert seldom.verified == often.verified
    assert often.log_scale[0] == pytest.approx(np.log(2.0), abs=0.1)
    assert seldom.log_scale[0] == pytest.approx(often.log_scale[0], abs=0.02)
