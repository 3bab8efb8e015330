"""The bench from end to end in its tiny size: it measures everything, and its figures hang together."""

import json
import subprocess
import sys

import pytest

from replay.lab.measuring.bench import __main__ as main_module
from replay.lab.measuring.bench import floor
from replay.lab.measuring.bench.catalogue import SECTIONS, _sections
from replay.lab.measuring.bench.report import page, table
from replay.lab.measuring.bench.targets import ROWS, judged
from replay.lab.measuring.bench.workload import slope


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    out = folder / "bench.json"
    # A cold start and the comparisons compile for half a minute; they have a test of their own.
    quick = [name for name in SECTIONS if name not in ("start", "comparisons", "fleet")]
    command = [
        sys.executable,
        "-m",
        "replay.lab.measuring.bench",
        "--size",
        "tiny",
        "--out",
        str(out),
        "--only",
        *quick,
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(out.read_text())


def test_every_section_has_figures_or_says_why_not(results):
    for name, found in results["sections"].items():
        assert "failed" not in found, name
        if "skipped" in found:
            assert found["skipped"]
    assert results["machine"]["processor"]
    assert results["machine"]["libraries"]["numpy"]


def test_both_implementations_were_timed_on_the_same_numbers(results):
    update = results["sections"]["update"]
    assert update["ratio"] > 0
    assert update["compiled"]["lower_quartile_s"] <= update["compiled"]["median_s"]
    assert update["largest_difference_K"] < 1e-6


def test_stages_add_up_to_the_update(results):
    stages = results["sections"]["stages"]
    total = sum(one["s"] for one in stages["stages"].values())
    assert total == pytest.approx(stages["instrumented_update_s"])
    assert {"propagate", "between"} <= stages["stages"].keys()
    assert stages["floor"]["operations_s"] > 0
    assert stages["peak"]["flops_per_s"] > 1e8


def test_growth_months_and_memory_are_positive(results):
    growth, months = results["sections"]["growth"], results["sections"]["months"]
    assert len(growth["particles"]) == len(growth["zones"]) == 3
    assert all(row["median_s"] > 0 for row in growth["particles"] + growth["zones"])
    assert months["samples"] == 144
    assert months["wall_s"] > 0
    assert months["peak_resident_bytes"] > 50e6
    assert results["sections"]["memory"]["base_bytes"] > 50e6


def test_the_page_has_a_row_for_every_target_that_was_measured(results, tmp_path):
    page(results, tmp_path / "performance.md")
    text = (tmp_path / "performance.md").read_text()
    for row in judged(results["sections"]):
        assert row.what in text
    assert "size `tiny`" in text.lower()
    pytest.importorskip("matplotlib")
    assert (tmp_path / "images" / "performance-growth.svg").read_text().startswith("<?xml")


def test_a_section_that_is_measured_anew_leaves_the_others_their_machine(tmp_path, monkeypatch, capsys):
    out = tmp_path / "bench.json"

    def bench(commit, *options):
        here = {"processor": "P", "cores": 2, "commit": commit, "date": "2026-11-22", "load_average_before": 0.5}
        here |= {"memory_bytes": 8e9, "system": "S", "python": "3.11", "libraries": {}, "thermogate": "1"}
        monkeypatch.setattr(main_module, "machine", lambda: here)
        monkeypatch.setattr(main_module, "measured", lambda name, size: {"failed": commit})
        monkeypatch.setattr(sys, "argv", ["bench", "--out", str(out), "--page", str(tmp_path / "page.md"), *options])
        return main_module.main()

    bench("old", "--size", "tiny")
    bench("new", "--size", "tiny", "--only", "memory")
    text = (tmp_path / "page.md").read_text()
    assert "| Thermogate | 1, commit old |" in text
    assert "`memory`: measured on P, commit new, 2026-11-22; load average before: 0.5 on 2 cores." in text
    assert text.count("commit new") == 1
    with pytest.raises(SystemExit):
        bench("new", "--only", "memory")
    assert "has figures of the size tiny" in capsys.readouterr().err


def test_a_section_that_failed_or_was_skipped_has_no_verdict():
    rows = judged({"update": {"failed": "it broke"}, "threads": {"skipped": "no option"}})
    assert {row.verdict for row in rows} == {"no figure"}
    assert "failed: it broke" in rows[0].measured
    assert any("skipped: no option" in line for line in table({"threads": {"skipped": "no option"}}))


def test_sections_are_those_that_can_be_named():
    assert tuple(_sections()) == SECTIONS
    assert {row.section for row in ROWS} <= set(SECTIONS)


def test_operations_grow_with_states_and_squarings():
    small, large = floor.operations(2, 4, 2, 3.0), floor.operations(5, 10, 5, 3.0)
    assert all(large[name] >= small[name] for name in small)
    more = floor.operations(5, 10, 5, 4.0)
    assert more["squarings"] > large["squarings"]
    assert more["exponential"] == large["exponential"]
    # 15 entries of 5 multiply-adds each.
    assert more["squarings"] - large["squarings"] == 2 * 75 + 15


def test_the_exponent_of_a_power_law_is_found():
    assert slope([1.0, 10.0, 100.0], [3.0, 30.0, 300.0]) == pytest.approx(1.0)
