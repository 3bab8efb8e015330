"""Readings of open intervals in the journal: there at the next start, once, and gone when they are of no more use."""

from __future__ import annotations

import logging
import sqlite3
from math import inf
from pathlib import Path

import numpy as np
import pytest

from adapters.reading import Quality, Reading
from service.records.sample import Sample
from service.store.journal import REMEMBERED, Journal

FIRST = [Reading("z/T_i", 100.5, 21.5), Reading("z/u", 101.0, -0.0, Quality.UNCERTAIN)]


def sample(time: int) -> Sample:
    return Sample(time, np.array([21.0]), np.array([1.0]), (Quality.GOOD,), (Quality.GOOD,))


def test_what_was_kept_is_there_after_the_journal_was_opened_again(tmp_path: Path) -> None:
    journal = Journal.open(tmp_path / "journal.sqlite3")
    journal.keep("z", FIRST)
    journal.keep("z", [FIRST[0]._replace(value=3.0), Reading("z/T_i", 102.0, 22.0)])
    journal.keep("other", [Reading("other/T_i", 100.5, 1.0)])
    journal._connection.close()
    again = Journal.open(tmp_path / "journal.sqlite3")
    assert again.kept("z", 0.0, inf) == [*FIRST, Reading("z/T_i", 102.0, 22.0)], "the first one stays"
    assert again.kept("z", 101.0, 101.5) == [FIRST[1]]
    assert again.kept("nobody", 0.0, inf) == []
    again.close()


def test_it_goes_when_it_is_too_old_to_be_posted_again(tmp_path: Path) -> None:
    journal = Journal.open(tmp_path / "journal.sqlite3")
    journal.keep("z", FIRST)
    journal.append("z", sample(100 + REMEMBERED))
    assert len(journal.kept("z", 0.0, inf)) == 2
    journal.append("z", sample(101 + REMEMBERED))
    assert journal.kept("z", 0.0, inf) == [FIRST[1]]
    journal.append("other", sample(102 + REMEMBERED))
    assert journal.kept("z", 0.0, inf) == [FIRST[1]]
    journal.close()


def test_a_reset_and_a_clock_that_was_set_back_put_it_aside(tmp_path: Path) -> None:
    journal = Journal.open(tmp_path / "journal.sqlite3")
    journal.keep("z", FIRST)
    journal.set_aside("z", 100)
    assert journal.kept("z", 0.0, inf) == []
    journal.keep("z", FIRST)
    journal.forget("z")
    assert journal.kept("z", 0.0, inf) == []
    assert len(journal.read("SELECT * FROM readings")) == 4
    journal.close()


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
