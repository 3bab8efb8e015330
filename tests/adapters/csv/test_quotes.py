"""Quotes that are not closed and lines without an end: they cost their own row, or are refused, and take no memory."""

import gzip
import tracemalloc

import pytest

from adapters.csv.config import LayoutConfig
from adapters.csv.table import CsvChannel, read_table
from adapters.errors import SourceUnavailable

ROWS = [f"2025-01-01T00:{minute:02}:00Z,{20 + minute}" for minute in range(50)]


def table(path, text, delimiter=","):
    path.write_text(text)
    return read_table(path, [CsvChannel("z/T", ("T",))], LayoutConfig(timestamp={"column": "t"}, delimiter=delimiter))


def quoted(*places):
    """Rows with a quote before the values of some of them."""
    return [row.replace(",", ',"') if place in places else row for place, row in enumerate(ROWS)]


@pytest.mark.parametrize(
    ("rows", "head", "delimiter"),
    [
        (quoted(20), "t,T", ","),
        ([*ROWS[:20], '"2025-01-01T00:20:00Z,40', *ROWS[21:]], "t,T", ","),
        ([*ROWS[:20], '2025-01-01T00:20:00Z, "40', *ROWS[21:]], "t,T", ","),
        (quoted(10, 40), "t,T", ","),
        ([f'{row},"a note\nover ""two"" lines"' for row in ROWS], "t,T,note", ","),
        ([f'{row};valve 5" pipe'.replace(",", ";") for row in ROWS], "t;T;note", ";"),
    ],
    ids=["not closed", "before the time", "after a blank", "far from each other", "over lines", "an inch"],
)
def test_a_quote_costs_no_row(tmp_path, rows, head, delimiter):
    found = table(tmp_path / "a.csv", "\n".join([head, *rows]) + "\n", delimiter)
    assert found.values[0].tolist() == [20.0 + minute for minute in range(50)]


def test_a_line_without_an_end_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "giant.csv.gz"
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(b"t,T\n")
        for _ in range(100):
            file.write(b"x" * 2**20)
    tracemalloc.start()
    try:
        with pytest.raises(SourceUnavailable, match="is it CSV"):
            read_table(path, [CsvChannel("z/T", ("T",))], LayoutConfig(timestamp={"column": "t"}))
        assert tracemalloc.get_traced_memory()[1] < 20 * 2**20
    finally:
        tracemalloc.stop()
