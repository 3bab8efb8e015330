"""How much heat a building loses, found by a co-heating test in weather that stands still. Each room in turn is held
warmer until nothing changes any more. Then the heating powers p and the temperatures over outdoors d of all tests obey
P = G D, with one column for each test, so G = P D^-1: row i of G holds the conductances of room i, and its sum is what
the room loses to outdoors per kelvin (UA)."""

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.energyplus.buildings import Building
from replay.energyplus.heating import proportional
from replay.energyplus.plant import STEP, Inputs, Plant, Readings
from replay.energyplus.weather import WeatherFile, write_steady
from replay.localtime import DAY

_COOL, _WARM = 19.0, 23.0  # degC
_BAND = 2.0  # K
_DAYS = 10
_AVERAGED = round(DAY / STEP)


class HeatLoss(NamedTuple):
    """In W/K: `outdoors` (N,) from each room to outdoors, and `between` (N, N) from room to room, 0 on the diagonal."""

    outdoors: Array
    between: Array


def heat_loss(building: Building, weather: WeatherFile, *, outdoor: float, wind: float) -> HeatLoss:
    """The heat loss of `building` at an outdoor temperature [degC] and a wind [m/s], without sun, under a cloudy sky,
    where `weather` is: the density of the air depends on the height."""
    rooms = len(building.rooms)
    powers, excess = np.empty((rooms, rooms)), np.empty((rooms, rooms))
    with tempfile.TemporaryDirectory(prefix="thermogate-co-heating-") as folder:
        steady = write_steady(Path(folder) / "steady.epw", weather, outdoor=outdoor, wind=wind)
        for test in range(rooms):
            held = np.where(np.arange(rooms) == test, _WARM, _COOL)
            powers[:, test], excess[:, test] = _settled(building, steady, held)
    conductances = powers @ np.linalg.inv(excess)
    between = -np.where(np.eye(rooms, dtype=bool), 0.0, conductances)
    return HeatLoss(conductances.sum(axis=1), between)


def _settled(building: Building, weather: WeatherFile, held: Array) -> tuple[Array, Array]:
    """Mean power [W] and temperature over outdoors [K] of every room (N,) on the last day."""
    rated = np.array([room.heater for room in building.rooms])

    def keep(now: Readings) -> Inputs:
        return Inputs(proportional(rated, now.air, held, _BAND), *np.zeros((len(Inputs._fields) - 1, len(rated))))

    powers, excess = [], []
    with Plant(building, weather, warm_up=keep) as plant:
        for _ in range(_DAYS * _AVERAGED):
            inputs = keep(plant.now)
            now = plant.step(inputs)
            powers.append(inputs.heating)
            excess.append(now.air - now.outdoor)
    return np.mean(powers[-_AVERAGED:], axis=0), np.mean(excess[-_AVERAGED:], axis=0)
