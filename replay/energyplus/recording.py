"""A period of a building's life as a logger would keep it, and the truth beside it."""

from collections.abc import Callable
from datetime import date
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.energyplus.buildings import Building
from replay.energyplus.heating import heating_named
from replay.energyplus.people import Life
from replay.energyplus.plant import STEP, Inputs, Plant, Truth
from replay.energyplus.weather import WeatherFile
from replay.localtime import DAY, Seconds
from replay.recorded.raw_telemetry import Sensor, measured

STEPS_A_DAY = round(DAY / STEP)
THERMOMETER = Sensor(noise_sd=0.03, resolution=0.01)
"""Of every temperature; heating power and irradiance are recorded as they are."""


class Recording(NamedTuple):
    """K rows, STEP s apart, of N rooms; inputs and truth act from the time of a row to that of the next. `times` (K,)
    are UTC s, `air` (K, N) and `outdoor` (K,) what the thermometers say and `exact` (K, N) what they should,
    `set_points` (K, N), all degC; `heating` (K, N) in W, `irradiance` (K,), global on the horizontal, and `facade`
    (K,), on the southern wall, in W/m2, `wind` (K,) in m/s. `persons` and the fields of `truth` are (K, N)."""

    building: Building
    weather: WeatherFile
    times: Seconds
    air: Array
    outdoor: Array
    set_points: Array
    heating: Array
    irradiance: Array
    facade: Array
    wind: Array
    exact: Array
    persons: Array
    truth: Truth


def record(
    building: Building,
    weather: WeatherFile | str,
    *,
    begin: date,
    days: int,
    heating: str,
    seed: int,
    tick: Callable[[], None] = lambda: None,
) -> Recording:
    """The life of `building` for `days` days, by the clock of the place; `tick` is called after each day.

    `heating` is a name of `replay.energyplus.heating.HEATINGS`. The same arguments give the same rows. Raises what
    `Plant` raises, and ReplayError for a heating that does not exist.
    """
    life = Life([room.use for room in building.rooms], STEP, seed)
    heat = heating_named(heating, building, seed)
    seen, acted, ended, wanted = [], [], [], []
    with Plant(building, weather, begin=begin) as plant:
        for step in range(days * STEPS_A_DAY):
            before, local = plant.now, plant.local_time
            wanted.append(life.set_points(local))
            acted.append(Inputs(heat(local, before.air, wanted[-1]), *life.at(local)))
            seen.append(before)
            ended.append(plant.step(acted[-1]))
            if (step + 1) % STEPS_A_DAY == 0:
                tick()
        file = plant.weather
    rng = np.random.default_rng([seed, 0x5E2])
    times = np.array([round(now.time) for now in seen], dtype=np.int64)
    exact = np.array([now.air for now in seen])
    return Recording(
        building,
        file,
        times,
        np.column_stack([measured(THERMOMETER, times, times, column, rng) for column in exact.T]),
        measured(THERMOMETER, times, times, np.array([now.outdoor for now in seen]), rng),
        np.array(wanted),
        np.array([after.truth.heating for after in ended]),
        np.array([now.irradiance for now in seen]),
        np.array([after.facade for after in ended]),
        np.array([now.wind for now in seen]),
        exact,
        np.array([inputs.people for inputs in acted]),
        Truth(*(np.array(column) for column in zip(*(after.truth for after in ended), strict=True))),
    )
