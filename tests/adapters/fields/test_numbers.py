import math

import pytest

from adapters.fields.numbers import is_level, number_in, read_number, read_whole, whole_in


@pytest.mark.parametrize("value", [0, -3, 2.5, 10**300])
def test_numbers_are_floats_afterwards(value):
    assert number_in(value) == float(value)
    assert isinstance(number_in(value), float)


@pytest.mark.parametrize("value", [True, False, "1", None, math.nan, math.inf, -math.inf, 10**400, [1]])
def test_what_is_no_number(value):
    assert number_in(value) is None


@pytest.mark.parametrize("value", [True, 1.0, "1", None, 0, 11])
def test_what_is_no_whole_number_in_the_range(value):
    assert whole_in(value, 1, 10) is None


def test_whole_numbers_have_no_bounds_unless_they_are_given():
    assert whole_in(10**400) == 10**400
    assert whole_in(1, 1, 10) == 1
    assert whole_in(10, 1, 10) == 10


@pytest.mark.parametrize(
    ("text", "number"), [("1e3", 1000.0), (" -2 ", -2.0), ("inf", None), ("nan", None), ("x", None)]
)
def test_numbers_of_a_command_line(text, number):
    assert read_number(text) == number


@pytest.mark.parametrize(("text", "number"), [("12", 12), ("-1", None), ("1.0", None), ("²", None), ("9" * 5000, None)])
def test_whole_numbers_of_a_command_line(text, number):
    assert read_whole(text) == number


def test_levels_lie_between_0_and_1():
    assert is_level(0.95)
    assert not any(map(is_level, (0.0, 1.0, -0.5, math.nan, math.inf)))
