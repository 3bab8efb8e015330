"""The tables of the sinks in a configuration: mistakes are sentences, and without a table nothing is opened."""

import json
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write

from service.config.load import load
from service.errors import ConfigError
from service.publish.kinds import SINK_KINDS

MISTAKES = json.loads(Path(__file__).with_name("mistakes.json").read_text(encoding="utf-8"))


def mistaken(folder: Path, kind: str, table: dict[str, Any]) -> str:
    """The sentence about the only mistake in a configuration with `table`."""
    with pytest.raises(ConfigError) as caught:
        load(write(folder, sound(folder) | {kind: table}))
    (problem,) = caught.value.problems
    assert problem.startswith(kind)
    return problem


@pytest.mark.parametrize(
    ("kind", "table", "sentence"), [(kind, *row) for kind, rows in MISTAKES.items() for row in rows]
)
def test_a_mistake_in_a_table_is_a_sentence(kind: str, table: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    assert sentence in mistaken(tmp_path, kind, table)


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adapters.mqtt.broker.find_spec", lambda name: None)
    assert "pip install 'thermogate[mqtt]'" in mistaken(tmp_path, "mqtt", {"host": "x"})


@pytest.mark.parametrize("kind", ["mqtt", "influxdb"])
def test_without_a_table_nothing_is_opened(kind: str, tmp_path: Path) -> None:
    assert SINK_KINDS[kind].open(load(write(tmp_path, sound(tmp_path))).table(kind), "htwg") is None
