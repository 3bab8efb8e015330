"""`thermogate show-config` and `thermogate networks`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.config_samples import inline_network, sound, write

from service.cli.main import main
from service.config.load import load

Capture = pytest.CaptureFixture[str]


def test_what_is_shown_is_a_configuration_that_means_the_same(tmp_path: Path, capsys: Capture) -> None:
    tables = sound(tmp_path)
    tables["zones"][0] |= {
        "network": inline_network(),
        "estimator_options": {"preset": "paper", "particles": 500},
        "channels": {
            "T_air": {"source": "log", "column": "Living", "unit": "degC"},
            "T_out": {"source": "log", "column": "Outside", "unit": "degC"},
            "u_heat": {"source": "log", "column": "Power1", "unit": "kW"},
            "I_sol": {"source": "log", "column": "Sun", "unit": "W/m2"},
            "n_people": {"source": "log", "column": "Sun", "unit": "people"},
        },
    }
    tables["zones"][1] |= {
        "estimator": "rbpf",
        "network": {"preset": "m5", "fixed": ["C_h"], "parameters": {"g_wi_adj": {"value": 50.0}}},
    }
    tables["zones"][1]["channels"] = {
        "T_air": {"source": "log", "column": "Bedroom", "unit": "degC"},
        "T_out": {"source": "log", "column": "Outside", "unit": "degC"},
        "T_adj": {"source": "log", "column": "Living", "unit": "degC"},
        "u_heat": {"source": "log", "column": "Power1", "unit": "kW"},
    }
    path = write(tmp_path, tables)
    assert main(["show-config", str(path)]) == 0
    shown = capsys.readouterr().out
    again = tmp_path / "again.toml"
    again.write_text(shown, encoding="utf-8")

    assert main(["show-config", str(again)]) == 0
    assert capsys.readouterr().out == shown
    first, second = load(path), load(again)
    assert (first.site, first.http, first.sinks, first.sources) == (
        second.site,
        second.http,
        second.sinks,
        second.sources,
    )
    for before, after in zip(first.zones, second.zones, strict=True):
        # What is known of sun and habits is written out; the networks below say whether it is the same.
        resolved = {"network": before.network, "habits": before.habits, "sun": before.sun, "estimator_options": {}}
        assert after.model_copy(update=resolved) == before.model_copy(update={"estimator_options": {}})
        was, now = before.network, after.network
        assert {p.name: (p.nominal, p.free) for p in was.parameters} == {
            p.name: (p.nominal, p.free) for p in now.parameters
        }
        assert [p for p in was.parameters if p.free] == sorted(
            now.free, key=lambda p: [q.name for q in was.parameters].index(p.name)
        )
        assert was.heat_inputs == now.heat_inputs


def test_output_that_nobody_reads_to_the_end_is_no_failure_to_talk_about(tmp_path: Path) -> None:
    path = write(tmp_path, sound(tmp_path))
    reading, writing = os.pipe()
    os.close(reading)

    ended = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys; from service.cli.main import main; sys.exit(main())",
            "show-config",
            str(path),
        ],
        stdout=writing,
        stderr=subprocess.PIPE,
        cwd=Path(__file__).parents[3],
        check=False,
    )
    os.close(writing)

    assert (ended.returncode, ended.stderr) == (1, b"")
