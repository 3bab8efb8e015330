"""What `thermogate check` and the log warn of, and start nevertheless."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write

from service.cli.main import main
from service.config.load import load

Capture = pytest.CaptureFixture[str]
HEAT = "zones[0] ('living').channels.u_heat"


def on_modbus(folder: Path, heat: dict[str, Any], **source: object) -> dict[str, Any]:
    """The sound configuration with its first zone on Modbus."""
    tables = sound(folder)
    bms = {"kind": "modbus", "host": "10.0.0.5", "first_register": 0, "type": "float32"}
    tables["sources"]["bms"] = bms | source
    tables["zones"][0]["channels"] = {
        "T_i": {"source": "bms", "register": 0, "unit": "degC"},
        "T_out": {"source": "bms", "register": 2, "unit": "degC"},
        "u_heat": {"source": "bms", "register": 4, "unit": "kW"} | heat,
    }
    return tables


def warnings(folder: Path, tables: dict[str, Any]) -> tuple[str, ...]:
    return load(write(folder, tables)).warnings


def test_the_first_of_many_polls_of_a_power(tmp_path: Path) -> None:
    (warning,) = warnings(tmp_path, on_modbus(tmp_path, {}))
    assert warning == (
        f"{HEAT}: the first reading of every 5min counts and the others do not, which suits power that is switched; "
        'write aggregate = "mean" if it varies, or "first" if not'
    )


@pytest.mark.parametrize(
    ("heat", "source"),
    [
        ({"aggregate": "mean"}, {}),
        ({"aggregate": "first"}, {}),
        ({"unit": "kWh"}, {}),
        ({"table": "coil", "unit": "%", "scale": 100, "nominal": 2000}, {}),
        ({}, {"poll": "5min"}),
    ],
    ids=["it varies", "it is switched", "a counter", "a single bit", "one poll in a period"],
)
def test_no_word_where_it_is_meant(heat: dict[str, Any], source: dict[str, Any], tmp_path: Path) -> None:
    assert warnings(tmp_path, on_modbus(tmp_path, heat, **source)) == ()


def test_other_live_sources_have_many_readings_too(tmp_path: Path) -> None:
    tables = on_modbus(tmp_path, {})
    tables["sources"]["post"] = {"kind": "http"}
    tables["zones"][0]["channels"]["u_heat"] = {"source": "post", "unit": "kW"}
    assert [warning.split(":")[0] for warning in warnings(tmp_path, tables)] == [HEAT]


def test_recordings_are_as_in_the_paper(tmp_path: Path) -> None:
    assert warnings(tmp_path, sound(tmp_path)) == ()


def test_a_source_that_no_zone_uses_is_no_mistake(tmp_path: Path, capsys: Capture) -> None:
    tables = sound(tmp_path)
    tables["sources"]["spare"] = {"kind": "modbus", "host": "10.0.0.5", "first_register": 0}
    path = write(tmp_path, tables)
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].startswith("OK: ")
    assert shown[-1] == (
        "warning: sources.spare: is not used by any zone and stays off; "
        "remove it, or name it as the source of a channel"
    )
    assert main(["show-config", str(path)]) == 0
    assert "warning" not in capsys.readouterr().out
