import pytest

from service.zone.aggregation import AGGREGATES, Span, default_aggregate


def test_the_default_rules_are_those_of_the_paper():
    assert [default_aggregate(unit) for unit in ("degC", "W", "W/m2", "persons")] == ["mean", "first", "mean", "mean"]


def test_a_time_weighted_mean_counts_a_reading_until_the_next_one():
    span = Span([330.0, 360.0, 540.0], [9.0, 1.0, 5.0], 300.0, 600.0)
    assert AGGREGATES["time_weighted"].combine(span) == pytest.approx((9 * 30 + 1 * 180 + 5 * 60) / 270)


def test_amounts_of_energy_become_the_mean_power_of_the_interval():
    """Three records of 100 Wh in a quarter of an hour are 1200 W."""
    span = Span([0.0, 300.0, 600.0], [360e3, 360e3, 360e3], 0.0, 900.0)
    assert AGGREGATES["energy"].combine(span) == pytest.approx(1200.0)


def test_power_of_a_counter_is_averaged_by_default():
    assert [default_aggregate("W", given) for given in ("kW", "kWh", "Wh", "%")] == ["first", "mean", "mean", "first"]
