"""Quotes that are not closed and lines without an end: they cost their own row, or are refused, and take no memory."""

from __future__ import annotations

import gzip
import tracemalloc
from pathlib import Path

import pytest

from adapters.csv.config import LayoutConfig
from adapters.csv.table import CsvChannel, Table, read_table
from adapters.errors import SourceUnavailable

ROWS = [f"2025-01-01T00:{minute:02}:00Z,{20 + minute}" for minute in range(50)]


def table(path: Path, text: str, delimiter: str = ",") -> Table:
    path.write_text(text)
    return read_table(path, [CsvChannel("z/T", ("T",))], LayoutConfig(timestamp={"column": "t"}, delimiter=delimiter))


@pytest.mark.parametrize("row", ['2025-01-01T00:20:00Z,"40', '"2025-01-01T00:20:00Z,40', '2025-01-01T00:20:00Z, "40'])
def test_a_quote_that_is_not_closed_costs_no_other_row(tmp_path: Path, row: str) -> None:
    rows = [*ROWS[:20], row, *ROWS[21:]]
    found = table(tmp_path / "a.csv", "\n".join(["t,T", *rows]) + "\n")
    assert len(found.times) == 50
    assert found.values[0].tolist() == [20.0 + minute for minute in range(50)]


def test_two_quotes_far_from_each_other_are_no_cell(tmp_path: Path) -> None:
    rows = [*ROWS[:10], ROWS[10].replace(",", ',"'), *ROWS[11:40], ROWS[40].replace(",", ',"'), *ROWS[41:]]
    found = table(tmp_path / "a.csv", "\n".join(["t,T", *rows]) + "\n")
    assert found.values[0].tolist() == [20.0 + minute for minute in range(50)]


def test_cells_in_quotes_may_go_over_lines_and_hold_quotes(tmp_path: Path) -> None:
    rows = [f'{row},"a note\nover ""two"" lines"' for row in ROWS]
    found = table(tmp_path / "a.csv", "\n".join(["t,T,note", *rows]) + "\n")
    assert found.values[0].tolist() == [20.0 + minute for minute in range(50)]


def test_an_inch_in_a_cell_is_a_character(tmp_path: Path) -> None:
    rows = [f'{row};valve 5" pipe'.replace(",", ";") for row in ROWS]
    found = table(tmp_path / "a.csv", "\n".join(["t;T;note", *rows]) + "\n", ";")
    assert found.values[0].tolist() == [20.0 + minute for minute in range(50)]


def test_a_line_without_an_end_is_refused_before_it_is_read(tmp_path: Path) -> None:
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
