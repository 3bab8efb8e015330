import math

from adapters.fields.numbers import is_level, number_in, read_number, read_whole, whole_in


def test_numbers_are_floats_afterwards_and_finite():
    assert [repr(number_in(value)) for value in (0, -3, 2.5, 10**300)] == ["0.0", "-3.0", "2.5", "1e+300"]
    wrong = [True, False, "1", None, math.nan, math.inf, -math.inf, 10**400, [1]]
    assert {number_in(value) for value in wrong} == {None}


def test_whole_numbers_have_no_bounds_unless_they_are_given():
    assert [whole_in(10**400), whole_in(1, 1, 10), whole_in(10, 1, 10)] == [10**400, 1, 10]
    assert {whole_in(value, 1, 10) for value in (True, 1.0, "1", None, 0, 11)} == {None}


def test_numbers_of_a_command_line():
    assert [read_number(text) for text in ("1e3", " -2 ", "inf", "nan", "x")] == [1000.0, -2.0, None, None, None]
    assert [read_whole(text) for text in ("12", "-1", "1.0", "²", "9" * 5000)] == [12, None, None, None, None]


def test_levels_lie_between_0_and_1():
    assert is_level(0.95)
    assert not any(map(is_level, (0.0, 1.0, -0.5, math.nan, math.inf)))
