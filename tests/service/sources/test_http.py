"""Sources of kind "http" in the configuration: what values are called, and every mistake in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write
from support.config_spoiling import Change, at

from adapters.http.source import HttpChannel, HttpSource
from service.config.load import load
from service.config.written import effective_toml
from service.errors import ConfigError


def posted(folder: Path) -> dict[str, Any]:
    """The sound configuration with its first zone posted to."""
    tables = sound(folder)
    tables["sources"]["telegraf"] = {"kind": "http", "stuck_after": "1h"}
    tables["zones"][0]["channels"] = {
        "T_i": {"source": "telegraf", "measurement": "mqtt", "tags": {"topic": "room 1"}, "unit": "degC"},
        "T_out": {"source": "telegraf", "name": "roof", "unit": "degF", "scale": 0.1, "stuck_after": "2h"},
        "u_heat": {"source": "telegraf", "unit": "kW"},
    }
    return tables


def channels(folder: Path, tables: dict[str, Any]) -> dict[str, HttpChannel]:
    source = load(write(folder, tables)).build_source("telegraf")
    assert isinstance(source, HttpSource)
    return {channel.id: channel for channel in source._listed}


def test_what_values_are_called(tmp_path: Path) -> None:
    found = channels(tmp_path, posted(tmp_path))
    air, out, heat = (found[f"living/{name}"] for name in ("T_i", "T_out", "u_heat"))
    assert (air.measurement, air.tags, air.field, air.name) == ("mqtt", {"topic": "room 1"}, "value", None)
    assert (out.measurement, out.tags, out.field, out.name) == ("living", {}, "T_out", "roof")
    assert (heat.measurement, heat.field, heat.unit) == ("living", "u_heat", "kW")
    assert out.unit is None, "the number of the client is scaled"
    assert [one.stuck_after for one in (air, out, heat)] == [3600.0, 7200.0, 3600.0]


def test_what_show_config_writes_is_read_again(tmp_path: Path) -> None:
    config = load(write(tmp_path, posted(tmp_path)))
    again = tmp_path / "again.toml"
    again.write_text(effective_toml(config), encoding="utf-8")
    assert effective_toml(load(again)) == effective_toml(config)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (at("zones", 0, "channels", "T_i", measurement=None), "field and tags belong to a measurement"),
        (at("zones", 0, "channels", "T_i", tags={"topic": 1}), "must be a text in quotes, not 1"),
        (at("zones", 0, "channels", "T_i", name=""), "must be a text in quotes"),
        (at("zones", 0, "channels", "T_i", key="x"), "T_i.key: is not a known key"),
        (at("sources", "telegraf", port=8080), "telegraf.port: is not a known key"),
        (at("sources", "telegraf", max_ahead="soon"), "max_ahead"),
    ],
)
def test_mistakes(change: Change, sentence: str, tmp_path: Path) -> None:
    tables = posted(tmp_path)
    change(tables)
    tables["zones"][0]["channels"]["T_i"] = {
        key: value for key, value in tables["zones"][0]["channels"]["T_i"].items() if value is not None
    }
    with pytest.raises(ConfigError) as refused:
        load(write(tmp_path, tables))
    assert any(sentence in problem for problem in refused.value.problems), refused.value.problems
