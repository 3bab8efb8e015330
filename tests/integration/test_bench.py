"""The bench in its tiny size: it measures, and its figures reach the page."""

from pathlib import Path

import pytest
from bench import run
from bench.daemons import Instant, during, instants
from bench.rows import growth
from support.observed import Answer, latency, loop_delays

# One of each module; the others take minutes more.
QUICK = ["update", "fleet"]


def test_figures_stand_beside_their_targets_in_a_page_that_keeps_what_a_person_wrote(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "performance.md"
    page.write_text(f"# Performance\n\nBefore.\n\n{run.BEGIN}\nold\n{run.END}\n\nAfter.\n")
    assert run.main(["--size", "tiny", "--page", str(page), "--only", *QUICK]) == 0, capsys.readouterr()
    written = page.read_text()
    for told in ("one complete update, one thread", "GB with 20 zones"):
        assert told in written
    assert "MISSING" not in written
    assert written.startswith("# Performance\n\nBefore.\n")
    assert written.endswith(f"{run.END}\n\nAfter.\n")
    assert "old" not in written
    assert run.measured("nothing", "tiny") == [run.Row("nothing", "", "failed: 'nothing'", False)]


def test_figures_are_made_of_what_was_seen() -> None:
    assert growth("time", "N", [(1, 3.0), (10, 30.0), (100, 300.0)]).measured == "p = 1.00 from 1 to 100"
    arrived = {0.0: {"a": 9.0, "b": 9.1}, 600.0: {"a": 11.0, "b": 11.5}, 1200.0: {"b": 13.0}, 1800.0: {"a": 15.0}}
    assert instants(arrived, 2, 2) == [Instant(11.0, 11.5, 0), Instant(13.0, 13.0, 1)]
    answers = [
        *(Answer("forecast", 9.9, 10.1, 200), Answer("zone", 12.0, 12.5, 503), Answer("metrics", 10.2, 10.9, 200))
    ]
    found = latency(during(answers, [Instant(10.0, 11.0, 0)]))
    assert found == pytest.approx({"requests": 1, "not_ok": 0, "p99_s": 0.2})
    name = "thermogate_event_loop_delay_seconds_bucket "
    before, after = (
        {f"{name}{bound}": count for bound, count in zip(("0.01", "0.02", "0.05", "inf"), counts, strict=True)}
        for counts in ((5.0,) * 4, (8.0, 9.0, 10.0, 10.0))
    )
    assert loop_delays(before, after) == {"timers": 5.0, "late": 1.0, "none_later_than_s": 0.05}
