import numpy as np
import pytest

from adapters.csv.cells import Cells, Status, convert, parse_numbers, sum_cells


def cells(*pairs):
    values, status = zip(*pairs, strict=True)
    return Cells(np.array(values, dtype=float), np.array(status, dtype=np.uint8))


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("21.5", Status.GOOD),
        (" 21.5 ", Status.GOOD),
        ("-1e3", Status.GOOD),
        ("", Status.MISSING),
        ("  ", Status.MISSING),
        ("NA", Status.MISSING),
        ("n/a", Status.MISSING),
        ("NULL", Status.MISSING),
        ("None", Status.MISSING),
        ("-", Status.MISSING),
        ("nan", Status.NOT_FINITE),
        ("NaN", Status.NOT_FINITE),
        ("inf", Status.NOT_FINITE),
        ("-Infinity", Status.NOT_FINITE),
        ("1e999", Status.NOT_FINITE),
        ("1_000", Status.NON_NUMERIC),
        ("21,5", Status.NON_NUMERIC),
        ("on", Status.NON_NUMERIC),
        ("21.5 C", Status.NON_NUMERIC),
    ],
)
@pytest.mark.parametrize("neighbours", [[], ["1.0"], ["broken"]], ids=["alone", "beside a number", "beside garbage"])
def test_every_kind_of_cell_has_its_status_whatever_stands_beside_it(text, status, neighbours):
    parsed = parse_numbers([text, *neighbours], ".")
    assert parsed.status[0] == status
    assert np.isfinite(parsed.values[0]) == (status is Status.GOOD)


def test_a_decimal_comma_is_read_and_a_point_beside_it_refused():
    parsed = parse_numbers(["21,5", "-3", "1.234", "1.234,5"], ",")
    assert parsed.values[:2].tolist() == [21.5, -3.0]
    assert parsed.status.tolist() == [Status.GOOD, Status.GOOD, Status.NON_NUMERIC, Status.NON_NUMERIC]
    assert parse_numbers(["21,5", "-3"], ",").values.tolist() == [21.5, -3.0]


def test_a_sum_is_missing_with_a_missing_part_and_faulty_with_a_faulty_one():
    first = cells((1.0, 0), (1.0, 0), (1.0, 0), (np.nan, Status.MISSING))
    second = cells((2.0, 0), (np.nan, Status.MISSING), (np.nan, Status.NON_NUMERIC), (np.nan, Status.NON_NUMERIC))
    total = sum_cells([first, second])
    assert total.status.tolist() == [Status.GOOD, Status.MISSING, Status.NON_NUMERIC, Status.NON_NUMERIC]
    assert total.values[0] == 3.0


def test_conversion_comes_before_the_valid_range():
    converted = convert(cells((1.0, 0), (2.0, 0), (-1.0, 0)), [(2.0, 0.5), (1000.0, 0.0)], (0.0, 4000.0))
    assert converted.values[0] == 2500.0
    assert converted.status.tolist() == [Status.GOOD, Status.OUT_OF_RANGE, Status.OUT_OF_RANGE]
    assert np.isnan(converted.values[1:]).all()


def test_the_ends_of_the_valid_range_are_valid_and_an_overflow_is_not_finite():
    converted = convert(cells((-1.0, 0), (1.0, 0), (1e308, 0)), [(1.0, 0.0), (10.0, 0.0)], (-10.0, 10.0))
    assert converted.status.tolist() == [Status.GOOD, Status.GOOD, Status.NOT_FINITE]
