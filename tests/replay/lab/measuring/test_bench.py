"""The bench in its tiny size: it measures, and its figures reach the JSON and the page."""

import json
import subprocess
import sys

import pytest

from replay.lab.measuring.bench import __main__ as bench
from replay.lab.measuring.bench.section import exponent

PAGE = f"# Performance\n\nBefore.\n\n{bench.BEGIN}\nold\n{bench.END}\n\nAfter.\n"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    page = folder / "performance.md"
    page.write_text(PAGE)
    # A cold start compiles for half a minute; the fleet has a test of its own.
    quick = ["update", "threads", "growth", "months", "memory"]
    options = ["--size", "tiny", "--out", str(folder / "bench.json"), "--page", str(page), "--only", *quick]
    command = [sys.executable, "-m", "replay.lab.measuring.bench", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "bench.json").read_text()), page.read_text()


def test_every_section_has_figures_beside_its_targets(results):
    measured, page = results
    for name, found in measured["sections"].items():
        assert found["targets"], name
        assert all(one["what"] in page and one["measured"] in page for one in found["targets"])
    assert "same bits" in measured["sections"]["threads"]["targets"][0]["measured"]
    assert [row[0] for row in measured["sections"]["update"]["details"][0]["rows"]] == ["rbpf", "ekf", "ukf"]


def test_the_page_keeps_what_a_person_wrote(results):
    _, page = results
    assert page.startswith("# Performance\n\nBefore.\n")
    assert page.endswith(f"{bench.END}\n\nAfter.\n")
    assert "old" not in page
    assert "only show that the measurements run" in page


def test_a_section_that_is_measured_anew_leaves_the_others_their_machine(tmp_path, monkeypatch, capsys):
    out, page = tmp_path / "bench.json", tmp_path / "page.md"
    page.write_text(PAGE)

    def run(commit, *options):
        monkeypatch.setattr(bench, "machine", lambda: {"processor": "P", "commit": commit, "date": "2026-11-22"})
        monkeypatch.setattr(bench, "measured", lambda name, size: {"failed": "it broke"})
        monkeypatch.setattr(sys, "argv", ["bench", "--out", str(out), "--page", str(page), *options])
        return bench.main()

    assert run("old", "--size", "tiny") == 1
    run("new", "--size", "tiny", "--only", "memory")
    assert "| commit | old |" in page.read_text()
    assert "`memory` was measured on: commit new." in page.read_text()
    assert page.read_text().count("commit new") == 1
    assert "| memory |  | failed: it broke | no figure |" in page.read_text()
    with pytest.raises(SystemExit):
        run("new", "--only", "memory")
    assert "has figures of the size tiny" in capsys.readouterr().err


def test_the_exponent_of_a_power_law_is_found():
    assert exponent([(1, 3.0), (10, 30.0), (100, 300.0)]) == pytest.approx(1.0)
