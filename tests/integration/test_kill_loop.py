"""The loop that `make kill-loop` runs for 500 kills, in small; and that it would notice a loss."""

from pathlib import Path

from integration.kill_loop import SCORES, ZONES, Loop
from integration.witness import differing, held


def test_killed_again_and_again_nothing_is_lost(tmp_path: Path) -> None:
    report = Loop(tmp_path, kills=4, seed=7).run()
    assert report.good, report.lines()
    assert sum(report.kills.values()) == 4
    killed_under_load = 4 - report.kills.get("start", 0)
    assert killed_under_load >= 2, "the seed chooses the moments"
    assert report.acknowledged >= killed_under_load * SCORES[0] * len(ZONES)
    assert report.history_rows > 200


def test_what_is_lost_and_what_differs_is_noticed() -> None:
    def entry(time: str, told_by: str = "history", **row: object) -> dict:
        return {"zone": "north", "told_by": told_by, "time": time, "row": row}

    rows = [{"time": "1", "mean": 20.0, "gate": 0.5}, {"time": "2", "mean": 21.0, "gate": 0.25}]
    entries = [entry("1", mean=20.0), entry("2", "gate", gate=0.25), entry("9", "forecast", mean=20.0)]
    assert held(entries, {"north": rows}).total() == 0, "what was forecast has not been measured yet"
    assert held([entry("1", mean=20.1)], {"north": rows}) == {"lost": 0, "differing": 1}
    assert held([entry("1", "forecast", mean=20.1)], {"north": rows}) == {"lost": 0, "differing": 1}
    assert held([entry("3", mean=20.0)], {"north": rows}) == {"lost": 1, "differing": 0}
    assert differing(rows, rows) == 0
    assert differing(rows[:1], rows) == 1
    assert differing([rows[0] | {"gate": 0.1}, rows[1]], rows) == 2
    assert differing([*rows, rows[0]], rows) == 2
