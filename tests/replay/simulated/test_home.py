import csv
import tomllib
from pathlib import Path

import numpy as np
import pytest

from estimator.network import presets
from replay.simulated.ecolar import COLUMNS
from replay.simulated.home import BEDROOM_FILE, BEDROOM_THETA, LIVING_FILE, write_demo


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_demo(tmp_path_factory.mktemp("demo") / "home", days=4, seed=3, port=0, pace=600)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _values(rows: list[dict[str, str]], column: str) -> np.ndarray:
    return np.array([float(row[column]) for row in rows if row[column]])


def test_configuration_is_toml_that_names_every_channel_of_its_networks(demo: Path) -> None:
    text = demo.read_text(encoding="utf-8")
    assert "synthetic" in text.splitlines()[0].lower()
    config = tomllib.loads(text)
    assert config["site"]["id"] == "demo"
    assert config["http"]["port"] == 0
    assert {source["pace"] for source in config["sources"].values()} == {600}
    assert [zone["id"] for zone in config["zones"]] == ["living", "bedroom"]
    for zone in config["zones"]:
        network = zone["network"]
        preset = presets.network(network if isinstance(network, str) else network["preset"])
        assert set(zone["channels"]) == set(preset.channels)
        for channel in zone["channels"].values():
            source = config["sources"][channel["source"]]
            (file,) = source["files"]
            header = set(_rows(demo.parent / file)[0])
            assert {source["timestamp"]["column"], *channel.get("columns", [channel.get("column")])} <= header
    assert (demo.parent / config["site"]["state_dir"]).resolve().parent == demo.parent.resolve()


def test_pace_may_be_as_fast_as_possible(tmp_path: Path) -> None:
    config = tomllib.loads(write_demo(tmp_path, days=1, pace="max").read_text(encoding="utf-8"))
    assert config["sources"]["living"]["pace"] == "max"
    assert config["http"]["port"] == 8080


def test_both_zones_are_lived_in_and_heated(demo: Path) -> None:
    living, bedroom = _rows(demo.parent / LIVING_FILE), _rows(demo.parent / BEDROOM_FILE)
    assert tuple(living[0]) == COLUMNS
    assert len(bedroom) == 4 * 1440
    for rows, column in ((living, "Temp2"), (bedroom, "bedroom_temperature")):
        assert 15 < _values(rows, column).min() < _values(rows, column).max() < 26
    assert 0.05 < (_values(living, "my-pv1") > 0).mean() < 0.98
    assert 0.05 < (_values(bedroom, "radiator_power") > 0).mean() < 0.95


def test_the_bedroom_is_what_the_living_zone_has_next_door(demo: Path) -> None:
    adjacent = _values(_rows(demo.parent / LIVING_FILE), "Other_room_temp")
    bedroom = _values(_rows(demo.parent / BEDROOM_FILE), "bedroom_temperature")
    assert np.quantile(adjacent, [0.1, 0.5, 0.9]) == pytest.approx(np.quantile(bedroom, [0.1, 0.5, 0.9]), abs=0.15)


def test_bedroom_parameters_lie_inside_the_box_of_the_network() -> None:
    for parameter in presets.network("titeth").parameters:
        assert parameter.lower < BEDROOM_THETA[parameter.name] < parameter.upper


def test_same_seed_same_home(demo: Path, tmp_path: Path) -> None:
    again = write_demo(tmp_path, days=4, seed=3, port=0, pace=600)
    for name in (LIVING_FILE, BEDROOM_FILE, demo.name):
        assert (again.parent / name).read_bytes() == (demo.parent / name).read_bytes()
