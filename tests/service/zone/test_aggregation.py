import pytest

from service.zone.aggregation import AGGREGATES, Span


def test_a_time_weighted_mean_counts_a_reading_until_the_next_one():
    span = Span([330.0, 360.0, 540.0], [9.0, 1.0, 5.0], 300.0, 600.0)
    assert AGGREGATES["time_weighted"].combine(span) == pytest.approx((9 * 30 + 1 * 180 + 5 * 60) / 270)
