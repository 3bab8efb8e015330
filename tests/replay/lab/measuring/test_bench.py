"""The bench in its tiny size: it measures, and its figures reach the JSON and the page."""

import json
import subprocess
import sys

import pytest

from replay.lab.measuring.bench import __main__ as bench
from replay.lab.measuring.bench.rows import Row, growth

PAGE = f"# Performance\n\nBefore.\n\n{bench.BEGIN}\nold\n{bench.END}\n\nAfter.\n"


def test_figures_stand_beside_their_targets_in_a_page_that_keeps_what_a_person_wrote(tmp_path):
    page, out = tmp_path / "performance.md", tmp_path / "bench.json"
    page.write_text(PAGE)
    # A cold start compiles for half a minute; the fleet has a test of its own.
    quick = ["update", "threads", "grown", "months", "memory"]
    options = ["--size", "tiny", "--out", str(out), "--page", str(page), "--only", *quick]
    command = [sys.executable, "-m", "replay.lab.measuring.bench", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    written, sections = page.read_text(), json.loads(out.read_text())["sections"]
    rows = [Row(*row) for name in quick for row in sections[name]["rows"]]
    assert all(f"| {row.what} | {row.target} | {row.measured} |" in written for row in rows)
    assert "same bits" in Row(*sections["threads"]["rows"][0]).measured
    assert written.startswith("# Performance\n\nBefore.\n")
    assert written.endswith(f"{bench.END}\n\nAfter.\n")
    assert "old" not in written
    assert "only show that the measurements run" in written


def test_a_section_that_is_measured_anew_leaves_the_others_their_machine(tmp_path, monkeypatch, capsys):
    out, page = tmp_path / "bench.json", tmp_path / "page.md"
    page.write_text(PAGE)

    def run(commit, *options):
        monkeypatch.setattr(bench, "machine", lambda: {"processor": "P", "commit": commit, "date": "2026-11-22"})
        monkeypatch.setattr(bench, "measured", lambda name, size: [Row(name, "", "failed: it broke", False)])
        monkeypatch.setattr(sys, "argv", ["bench", "--out", str(out), "--page", str(page), *options])
        return bench.main()

    assert run("old", "--size", "tiny") == 1
    run("new", "--size", "tiny", "--only", "memory")
    assert "| commit | old |" in page.read_text()
    assert "`memory` was measured on: processor P, commit new, date 2026-11-22." in page.read_text()
    assert page.read_text().count("commit new") == 1
    assert "| memory |  | failed: it broke | missed |" in page.read_text()
    with pytest.raises(SystemExit):
        run("new", "--only", "memory")
    assert "has figures of the size tiny" in capsys.readouterr().err


def test_the_exponent_of_a_power_law_is_found():
    assert growth("time", "N", [(1, 3.0), (10, 30.0), (100, 300.0)]).measured == "p = 1.00 from 1 to 100"
