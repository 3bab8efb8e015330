"""The closed loop: a building of EnergyPlus, its thermometers, and a controller."""

from abc import ABC, abstractmethod
from datetime import date
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.energyplus.plant import Plant
from replay.energyplus.recording import THERMOMETER
from replay.lab.experiments.control.cases import OFF, STEPS_A_DAY, STUCK, Scene, lived, steps_with
from replay.localtime import Seconds
from replay.scores.intervals import Mask

BEGIN = date(2025, 1, 6)
"""The first day, a Monday."""
_NOISE_STREAM = 0xC10


class Moment(NamedTuple):
    """What a controller sees at the beginning of step `step`: UTC s, local s, what the thermometers show (N,)."""

    step: int
    time: int
    local: float
    shown: Array


class Lived(NamedTuple):
    """K steps of the life of N rooms. `air` (K, N) is exact and at the beginning of each step, `shown` (K, N) is what
    the thermometers said; `heating` (K, N) [W], `outdoor` (K,) and `irradiance` (K,), on the horizontal, hold over
    the step. `planned` (K, N) says whether a plan heated, and not a thermostat."""

    times: Seconds
    local: Array
    air: Array
    shown: Array
    heating: Array
    outdoor: Array
    irradiance: Array
    planned: Array


class Controller(ABC):
    """Heats the rooms of a building; learns nothing unless it says so."""

    @abstractmethod
    def powers(self, moment: Moment) -> tuple[Array, Mask]:
        """(N,) W over the coming step, and (N,) whether they are planned."""

    def saw(self, moment: Moment, heating: Array, outdoor: float, irradiance: float) -> None:  # noqa: B027
        """What has happened in the step that began at `moment`."""


def close(scene: Scene, controller: Controller) -> Lived:
    """The life of `scene` under `controller`."""
    life, stuck, off = scene.life(), steps_with(STUCK, scene), steps_with(OFF, scene)
    errors = _errors(scene)
    rows: list[tuple[object, ...]] = []
    shown = np.empty(0)
    with Plant(scene.of, scene.weather, begin=BEGIN) as plant:
        for index in range(scene.steps):
            now, local = plant.now, plant.local_time
            before, shown = shown, np.round((now.air + errors[index]) / THERMOMETER.resolution) * THERMOMETER.resolution
            if stuck[index] and len(before):
                shown[0] = before[0]
            moment = Moment(index, round(now.time), local, shown)
            wanted, planned = controller.powers(moment)
            heating = plant.step(lived(scene, life, index, local, np.where(off[index], 0.0, wanted))).truth.heating
            controller.saw(moment, heating, now.outdoor, now.irradiance)
            rows.append((moment.time, local, now.air, shown, heating, now.outdoor, now.irradiance, planned))
    return Lived(*(np.array(column) for column in zip(*rows, strict=True)))


def weather_of(scene: Scene) -> tuple[Array, Array]:
    """Outdoor temperature [degC] and irradiance [W/m2] of every step of the scene and of the day after it."""
    with Plant(scene.of, scene.weather, begin=BEGIN) as plant:
        seen = []
        for _ in range(scene.steps + STEPS_A_DAY):
            seen.append((plant.now.outdoor, plant.now.irradiance))
            plant.step(plant.idle())
    outdoor, irradiance = np.array(seen).T
    return outdoor, irradiance


def _errors(scene: Scene) -> Array:
    """(K, N): noise of the thermometers [K], the same whoever controls."""
    rng = np.random.default_rng([scene.seed, _NOISE_STREAM])
    return np.asarray(THERMOMETER.noise_sd * rng.standard_normal((scene.steps, len(scene.of.rooms))))
