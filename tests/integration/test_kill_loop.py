"""The loop that `make kill-loop` runs for 500 kills, in small; and that it would notice a loss."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest
from integration import kill_loop
from integration.kill_loop import SCORES, ZONES, Loop
from support.harness import Daemon

from service.records.history import HISTORY_COLUMNS
from service.store.journal_rows import history_checksum


def test_killed_again_and_again_nothing_is_lost(tmp_path: Path) -> None:
    report = Loop(tmp_path, kills=4, seed=7).run(progress=False)
    assert report.good, report.line()
    assert sum(report.moments.values()) == 4
    killed_under_load = 4 - report.moments.get("start", 0)
    assert killed_under_load >= 2, "the seed chooses the moments"
    assert report.acknowledged >= killed_under_load * SCORES[0] * len(ZONES)
    assert report.history_rows > 200


def test_the_loop_notices_what_is_lost_and_what_differs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kills = 0
    kill = Daemon.kill

    def kill_and_forge(daemon: Daemon) -> None:
        nonlocal kills
        kill(daemon)
        kills += 1
        if kills == 2:
            connection = sqlite3.connect(tmp_path / "state" / "journal.sqlite3")
            with connection:
                # All that is old: the ledger does not hear of everything, and what is new is made anew.
                (middle,) = connection.execute(
                    "SELECT (min(time) + max(time)) / 2 FROM history WHERE zone = 'north'"
                ).fetchone()
                old = "zone = 'north' AND time < ?"
                connection.execute(f"DELETE FROM history WHERE {old} AND time / 60 % 2 = 0", (middle,))
                # With the right checksum, only the ledger knows better.
                columns = ", ".join(HISTORY_COLUMNS)
                for row in connection.execute(f"SELECT {columns} FROM history WHERE {old}", (middle,)).fetchall():
                    cells = dict(zip(HISTORY_COLUMNS, row, strict=True))
                    cells["gate"] /= 2
                    checksum = history_checksum("north", list(cells.values()))
                    forged = (cells["gate"], checksum, cells["time"])
                    connection.execute(
                        "UPDATE history SET gate = ?, checksum = ? WHERE zone = 'north' AND time = ?", forged
                    )
            connection.close()

    monkeypatch.setattr(Daemon, "kill", kill_and_forge)
    monkeypatch.setattr(kill_loop.random.Random, "choices", lambda *_: ["load"])
    report = Loop(tmp_path, kills=2, seed=7).run(progress=False)
    assert not report.good
    assert report.lost > 0
    assert report.differing > 0
    assert report.history_differing > 2
