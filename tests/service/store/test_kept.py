"""Readings of open intervals in the journal: there at the next start, once, and gone when they are of no more use."""

from __future__ import annotations

import logging
import sqlite3
from math import inf
from pathlib import Path

import pytest

from adapters.reading import Quality, Reading
from service.store.journal import Journal

FIRST = [Reading("z/T_i", 100.5, 21.5), Reading("z/u", 101.0, -0.0, Quality.UNCERTAIN)]


@pytest.mark.parametrize(
    "column", ["value = value + 1e-9", "quality = 'uncertain'", "channel = 'z/X'", "time = 100.25"]
)
def test_a_damaged_one_is_said_and_left_out(column: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "journal.sqlite3"
    journal = Journal.open(path)
    journal.keep("z", FIRST)
    journal.close()
    with sqlite3.connect(path) as connection:
        connection.execute(f"UPDATE readings SET {column} WHERE channel = 'z/T_i'")
    connection.close()
    again = Journal.open(path)
    with caplog.at_level(logging.ERROR):
        assert again.kept("z", 0.0, inf) == [FIRST[1]]
    assert "damaged reading of zone 'z'" in caplog.text
    again.close()
