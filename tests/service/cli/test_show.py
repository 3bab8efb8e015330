"""`thermogate show-config` and `thermogate networks`."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import inline_network, sound, write

from estimator.network import presets
from service.cli.main import main
from service.config.load import load

Capture = pytest.CaptureFixture[str]


def effective(path: Path, capsys: Capture, *options: str) -> dict[str, Any]:
    assert main(["show-config", str(path), *options]) == 0
    return tomllib.loads(capsys.readouterr().out)


def test_overrides_and_options_show(tmp_path: Path, capsys: Capture) -> None:
    path = write(tmp_path, sound(tmp_path))

    shown = effective(
        path,
        capsys,
        *("--set", "zones.living.estimator_options.preset=paper"),
        *("--set", "zones.living.estimator_options.volatility_blocks={air = ['T_i'], wall = ['T_e']}"),
        *("--set", "sources.log.pace=60"),
    )

    assert shown["sources"]["log"]["pace"] == 60
    options = shown["zones"][0]["estimator_options"]
    assert options["coordinates"] == "log"
    assert options["volatility_blocks"] == {"air": ["T_i"], "wall": ["T_e"]}


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


def test_networks_lists_every_preset_with_its_states_and_inputs(capsys: Capture) -> None:
    assert main(["networks"]) == 0

    header, *lines = capsys.readouterr().out.splitlines()
    assert header.split() == ["network", "states", "inputs", "parameters", "what", "it", "is"]
    assert [line.split()[0] for line in lines] == list(presets.PRESETS)
    tite = next(line for line in lines if line.startswith("tite "))
    assert tite.split()[1:6] == ["T_i,", "T_e", "T_out,", "u_heat", "4"]


def test_network_by_name_lists_its_parameters(capsys: Capture) -> None:
    assert main(["networks", "tite", "--set", "solar=true", "--set", "parameters.C_e.value=3e7"]) == 0

    _, states, channels, variants, *table = capsys.readouterr().out.splitlines()
    assert states == "states: T_i, T_e"
    assert channels == "channels: T_i [degC], T_out [degC], u_heat [W], I_sol [W/m2]"
    assert variants == "variants for members of a bank: own, ground, two-layers"
    assert [line.split() for line in table] == [
        ["parameter", "unit", "lower", "upper", "nominal", "free"],
        ["C_i", "J/K", "100000", "1e+08", "2e+06", "yes"],
        ["C_e", "J/K", "-", "-", "3e+07", "no"],
        ["g_ie", "W/K", "10", "10000", "500", "yes"],
        ["g_e_out", "W/K", "5", "5000", "150", "yes"],
        ["A_w", "m2", "0.1", "30", "3", "yes"],
    ]


def test_unknown_network(capsys: Capture) -> None:
    assert main(["networks", "titet"]) == 2
    assert 'unknown network "titet"' in capsys.readouterr().err


def test_a_network_that_no_building_has_is_refused(capsys: Capture) -> None:
    assert main(["networks", "tite", "--set", "parameters.C_i.value=1e300"]) == 2
    assert capsys.readouterr().err.startswith("thermogate: network 'tite': parameter 'C_i' has value 1e+300, outside")


def test_overrides_of_all_networks_at_once_are_refused(capsys: Capture) -> None:
    assert main(["networks", "--set", "solar=true"]) == 2
    assert capsys.readouterr().err.startswith("thermogate: --set changes one network here; name it")


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
