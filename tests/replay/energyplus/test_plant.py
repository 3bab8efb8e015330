"""The live plant against EnergyPlus itself: balances, sampling, several at once, and what goes wrong."""

import errno
import os
from concurrent.futures import ThreadPoolExecutor
from datetime import date
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from support.energyplus import needs_energyplus

from replay.energyplus.buildings import BUILDINGS, Building
from replay.energyplus.engine import EnergyPlusError
from replay.energyplus.heating import HEATINGS, heating_named
from replay.energyplus.people import Life
from replay.energyplus.plant import STEP, Inputs, Plant, Readings
from replay.errors import WeatherFileError
from replay.localtime import DAY

pytestmark = needs_energyplus

HOUSE, TIMBER = BUILDINGS["house"], BUILDINGS["timber"]


def lived(building: Building, steps: int, *, heating: str = "on-off", weather: str = "denver", seed: int = 1):
    """Readings before and after every step, and the inputs of the step."""
    life = Life([room.use for room in building.rooms], STEP, seed)
    heat = heating_named(heating, building, seed)
    rows: list[tuple[Readings, Inputs, Readings]] = []
    with Plant(building, weather) as plant:
        for _ in range(steps):
            before, local = plant.now, plant.local_time
            inputs = Inputs(heat(local, before.air, life.set_points(local)), *life.at(local))
            rows.append((before, inputs, plant.step(inputs)))
    return rows


@pytest.fixture(scope="module")
def two_days():
    return lived(HOUSE, 576, heating="planned")


@pytest.mark.parametrize(("name", "heating"), [*zip(BUILDINGS, HEATINGS, strict=True)])
def test_the_balance_of_the_air_closes_in_every_step(name: str, heating: str) -> None:
    """What enters the air in [t_k, t_k+1) is what it holds more at t_k+1 than at t_k."""
    rows = lived(BUILDINGS[name], 150, heating=heating)
    for before, _, after in rows:
        truth = after.truth
        gained = truth.convective + truth.convection + truth.windows + truth.infiltration + truth.doors
        np.testing.assert_allclose(truth.storage, gained, atol=0.5)
        assert np.all(np.isfinite(after.air))
        assert after.time == before.time + STEP
    # The air's capacity [J/K] is one number for the whole run, apart from what its moisture and pressure do to it.
    kept = np.array([after.truth.storage * STEP for _, _, after in rows[1:]])
    warmer = np.array([after.air - before.air for before, _, after in rows[1:]])
    capacity = (kept * warmer).sum(axis=0) / (warmer**2).sum(axis=0)
    assert np.all(np.abs(kept - capacity * warmer).max(axis=0) < 0.02 * np.abs(kept).max(axis=0))
    # Shifted by one row, nothing fits.
    assert np.all(np.abs(kept[1:] - capacity * warmer[:-1]).max(axis=0) > 0.2 * np.abs(kept).max(axis=0))


def test_inputs_act_in_their_own_step(two_days) -> None:
    for before, inputs, after in two_days:
        np.testing.assert_allclose(after.truth.heating, inputs.heating)
        np.testing.assert_allclose(after.truth.equipment, inputs.equipment)
        np.testing.assert_allclose(after.truth.lights, inputs.lights)
        assert np.all((after.truth.people > 0) == (inputs.people > 0))
        # Open windows exchange air with the outdoor temperature that `before` shows for the step.
        exchanged = inputs.opening * (before.outdoor - after.air)
        np.testing.assert_allclose(after.truth.windows, exchanged, rtol=0.03, atol=1.0)
    assert max(inputs.opening.max() for _, inputs, _ in two_days) > 0


def test_the_first_moment_is_the_midnight_of_the_place_in_a_settled_building() -> None:
    with Plant(TIMBER, "chicago", begin=date(2025, 12, 30)) as plant:
        assert plant.now.time == 1767074400.0  # 2025-12-30T06:00:00Z
        assert plant.local_time % DAY == 0
        assert 17.5 < plant.now.air[0] < 20.5, "kept at 20 degC with a band of 2 K while EnergyPlus warmed up"
        first = plant.now.outdoor
        for _ in range(3 * 288):
            plant.step(plant.idle())
        # Over New Year, which a typical year does not have, time goes on and the building cools.
        assert plant.now.time == 1767074400.0 + 3 * DAY
        assert plant.now.air[0] < 15.0
        assert abs(plant.now.outdoor - first) < 40


def test_several_plants_live_at_once_without_touching_each_other() -> None:
    homes = {"a": (HOUSE, "denver"), "b": (TIMBER, "tampa"), "c": (HOUSE, "denver")}

    def live(key: str) -> list[tuple[Readings, Inputs, Readings]]:
        building, weather = homes[key]
        return lived(building, 96, weather=weather)

    alone, other = live("a"), live("b")
    with ThreadPoolExecutor(len(homes)) as pool:
        found = dict(zip(homes, pool.map(live, homes), strict=True))
    for key, expected in (("a", alone), ("b", other), ("c", alone)):
        for (_, _, left), (_, _, right) in zip(found[key], expected, strict=True):
            np.testing.assert_array_equal(left.air, right.air)


def test_what_is_asked_too_much_is_cut_and_what_is_no_number_is_refused() -> None:
    with Plant(TIMBER) as plant:
        now = plant.step(plant.idle()._replace(heating=np.array([1e9]), opening=np.array([-5.0])))
        assert now.truth.heating[0] == TIMBER.rooms[0].heater
        assert now.truth.windows[0] == 0.0
        with pytest.raises(EnergyPlusError, match="not a finite number"):
            plant.step(plant.idle()._replace(people=np.array([np.nan])))
        assert plant.step(plant.idle()).time == now.time + STEP, "the plant lives on"
    with pytest.raises(EnergyPlusError, match="has ended"):
        plant.step(plant.idle())
    plant.close()


def test_a_disk_that_cannot_be_written_is_reported_to_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "write_text", Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    with pytest.raises(EnergyPlusError, match=r"in.epJSON: cannot be written \(No space left on device\); make room"):
        Plant(TIMBER)


def test_warm_up_is_controlled_and_its_failure_reported_to_the_caller() -> None:
    def hot(readings: Readings) -> Inputs:
        seen.append(float(readings.air[0]))
        power = 6000.0 if readings.air[0] < 25.0 else 0.0
        return Inputs(*np.zeros((5, 1)))._replace(heating=np.array([power]))

    seen: list[float] = []
    with Plant(TIMBER, warm_up=hot) as plant:
        assert 24.0 < plant.now.air[0] < 28.0
        assert len(seen) >= 6 * 288, "at least the six days that the model asks for"
    with pytest.raises(RuntimeError, match="no controller today"):
        Plant(TIMBER, warm_up=Mock(side_effect=RuntimeError("no controller today")))


@pytest.mark.parametrize(
    ("text", "error", "said"),
    [
        (None, WeatherFileError, "No such file"),
        ("Dear all\n", WeatherFileError, "begins with LOCATION"),
        ("LOCATION,a,b,c,d,e,1,2,early,3\n", WeatherFileError, "'1, 2, early', are not three numbers"),
        ("LOCATION,a,b,c,d,e,1,2,-7.0,3\n", EnergyPlusError, "EnergyPlus has ended: "),
    ],
)
def test_weather_that_is_none_is_refused_in_one_sentence(text, error, said, tmp_path) -> None:
    path = tmp_path / "letter.epw"
    if text is not None:
        path.write_text(text)
    with pytest.raises(error, match=said):
        Plant(TIMBER, str(path))
    with pytest.raises(WeatherFileError, match=r"neither one of chicago, denver, .* nor the path of an EPW file"):
        Plant(TIMBER, "atlantis")
