"""Recordings of EnergyPlus buildings: reproducible rows, files that replay, a heat loss that the rows bear out."""

import json
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from support.energyplus import needs_energyplus
from support.tables import rows_of

from replay.energyplus.buildings import BUILDINGS
from replay.energyplus.files import CONFIGURATION, HEAT_LOSS, RECORDING, TRUTH
from replay.energyplus.heat_loss import heat_loss
from replay.energyplus.library import weather_folder
from replay.energyplus.recording import Recording, record
from replay.energyplus.weather import weather_file
from replay.localtime import DAY
from service.cli.main import main
from service.config.load import load

pytestmark = needs_energyplus

TIMBER = BUILDINGS["timber"]


@pytest.fixture(scope="module")
def week() -> Recording:
    return record(TIMBER, "chicago", begin=date(2025, 12, 29), days=7, heating="planned", seed=4)


def test_the_same_arguments_give_the_same_rows(week: Recording) -> None:
    days = []
    again = record(
        TIMBER, "chicago", begin=date(2025, 12, 29), days=2, heating="planned", seed=4, tick=lambda: days.append(1)
    )
    assert len(days) == 2
    rows = slice(2 * 288)
    for name in ("times", "exact", "heating", "irradiance", "persons"):
        np.testing.assert_array_equal(getattr(again, name), getattr(week, name)[rows])
    other = record(TIMBER, "chicago", begin=date(2025, 12, 29), days=1, heating="planned", seed=5)
    assert np.abs(other.exact - week.exact[:288]).max() > 0.1


def test_rows_are_five_minutes_apart_over_new_year_with_the_sun_of_their_step_and_noise(week: Recording) -> None:
    assert week.times[0] == 1766988000  # 2025-12-29T06:00:00Z, midnight in Chicago
    assert set(np.diff(week.times)) == {300}
    assert len(week.times) == 7 * 288
    through = week.truth.sun[:, 0] > 0
    assert ((week.irradiance > 0) == through).all()
    assert ((week.facade > 0) == through).all()
    errors = week.air - week.exact
    assert 0.025 < errors.std() < 0.036
    assert abs(errors.mean()) < 5 * 0.03 / np.sqrt(errors.size)


def test_the_heat_loss_is_that_of_the_layers() -> None:
    """Against U-values by hand: layers in series between the usual resistances of the air (ISO 6946)."""
    building = BUILDINGS["house"]
    found = heat_loss(building, weather_file("denver", weather_folder()), outdoor=0.0, wind=3.4)
    for index, room in enumerate(building.rooms):
        dx, dy, dz = room.size
        areas = dict.fromkeys(("south", "north"), dx * dz) | dict.fromkeys(("east", "west"), dy * dz)
        areas |= dict.fromkeys(("floor", "ceiling"), dx * dy)
        loss = 0.0
        for side, area in areas.items():
            if side in room.beside:
                continue
            layers = {"floor": building.ground, "ceiling": building.roof}.get(side, building.wall)
            resistance = 0.17 + sum(layer.thickness / layer.material.conductivity for layer in layers)
            glass = room.windows.get(side, 0.0)
            loss += (area - glass) / resistance + glass * building.glazing.u_value
        loss += building.air_changes / 3600 * room.volume * 1006 * 1.03  # air at 1,829 m
        assert found.outdoors[index] == pytest.approx(loss, rel=0.15)
    # What goes from one room to another comes back the same way.
    np.testing.assert_allclose(found.between, found.between.T, rtol=0.1, atol=0.5)
    assert np.all(np.diag(found.between) == 0.0)
    for index in range(len(building.rooms)):
        assert np.all(found.between[index, list(building.neighbours(index))] > 10.0)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("office")
    words = ["--out", str(folder), "--building", "office", "--days", "2", "--heating", "on-off"]
    assert main(["simulate-energyplus", *words]) == 0
    return folder


def test_the_files_hold_the_recording_and_the_truth(written: Path) -> None:
    rows, truth = (rows_of(written / name) for name in (RECORDING, TRUTH))
    assert [row["time"] for row in rows] == [row["time"] for row in truth]
    assert rows[0]["time"] == "2025-01-06T07:00:00Z"
    assert len(rows) == 2 * DAY // 300
    for row, true in zip(rows, truth, strict=True):
        for room in ("west", "hall", "east"):
            assert float(row[f"{room}_heating_W"]) == pytest.approx(float(true[f"{room}_heating_W"]), abs=0.1)
            assert abs(float(row[f"{room}_degC"]) - float(true[f"{room}_degC"])) < 0.2
            gain = sum(float(true[f"{room}_{name}_W"]) for name in ("people", "equipment", "lights", "windows"))
            assert gain == pytest.approx(float(true[f"{room}_gain_W"]), abs=0.03)
    loss = json.loads((written / HEAT_LOSS).read_text())
    assert loss["unit"] == "W/K"
    assert [*loss["rooms"]["hall"]["neighbours"]] == ["west", "east"]
    assert 40 < loss["rooms"]["west"]["outdoors"] < 55


def test_the_configuration_replays_the_recording(written: Path, tmp_path: Path) -> None:
    config = load(written / CONFIGURATION, [])
    assert [zone.id for zone in config.zones] == ["west", "hall", "east"]
    assert config.zones[1].network.boundaries == ("T_out", "T_adj_east", "T_adj_west")
    settings = ["--zone", "hall", "--set", "zones.hall.estimator=ekf", "--set", "zones.hall.estimator_options={}"]
    assert main(["replay", str(written / CONFIGURATION), "--out", str(tmp_path), *settings]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["zones"]["hall"]["samples"] == 2 * DAY // 300


def test_mistakes_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate-energyplus", "--out", str(tmp_path), "--begin", "today"]) == 2
    assert "'today' is no day such as 2025-01-06" in capsys.readouterr().err
