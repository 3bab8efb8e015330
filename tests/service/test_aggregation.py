import pytest

from service.aggregation import aggregate, default_aggregate
from service.errors import ConfigError


def test_the_default_rules_are_those_of_the_paper():
    assert [default_aggregate(unit) for unit in ("degC", "W", "W/m2", "persons")] == ["mean", "first", "mean", "mean"]


def test_an_unknown_rule_gets_the_list():
    with pytest.raises(ConfigError, match="the aggregates are mean, first, last, min, max, sum"):
        aggregate("average")


@pytest.mark.parametrize("value", [0.1, 21.3, -7.7])
@pytest.mark.parametrize("count", [3, 7, 30])
def test_the_mean_of_equal_readings_is_that_reading(value, count):
    assert aggregate("mean").combine([value] * count) == value
