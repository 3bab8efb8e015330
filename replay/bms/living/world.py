"""The building living: physics in exact steps, thermostats, people, and the noise of the sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.bms.living.building import AIR, ENVELOPE, HEATER, NODES, Building, whole_network
from replay.bms.living.calendar import FIRST_MIDNIGHT, Calendar
from replay.localtime import HOUR
from replay.simulated.simulate import dynamics

STEP = 5.0
"""Simulated seconds per step."""
BEGIN = 6 * HOUR
"""The building wakes at this time of its first day, seconds after midnight."""

_PROCESS_NOISE_SD = 0.0005  # K per node and step
SENSOR_NOISE_SD = 0.03  # K


class Snapshot(NamedTuple):
    """The building between two steps, per room (N,): `time` in simulated UTC s, temperatures in degC, `power` and
    `gain` (people, sun and windows) in W, `energy` in J since the beginning, `opening` in W/K. `noise` (N + 1,) [K] is
    what the sensors add, one of every room, then the outdoor one."""

    time: float
    air: Array
    envelope: Array
    heater: Array
    set_point: Array
    power: Array
    energy: Array
    gain: Array
    opening: Array
    noise: Array
    outdoor: float
    irradiance: float


class Orders(NamedTuple):
    """What somebody at the plant wants, per room (N,): set-points in degC and heating in W; NaN: nothing."""

    set_point: Array
    power: Array

    @classmethod
    def none(cls, rooms: int) -> Orders:
        """Thermostats and their schedule have it their way."""
        return cls(np.full(rooms, np.nan), np.full(rooms, np.nan))


class World:
    """A building and its calendar, advanced step by step; the same seed and windows always give the same numbers."""

    def __init__(self, building: Building, seed: int) -> None:
        self.building = building
        network, theta = whole_network(building)
        self._dynamics = dynamics(network, theta, STEP)
        self._memory = [0.0] * len(building.rooms)
        """Of the thermostats."""
        self._aperture = np.array([room.theta["A_w"] for room in building.rooms])
        self._calendar = Calendar(len(building.rooms), seed)
        self._rng = np.random.default_rng([seed, 0x11FE])
        self._steps = 0
        self._energy = np.zeros(len(building.rooms))
        self._state = self._settled(building)
        rooms = len(building.rooms)
        self.now = self._look(np.zeros(rooms), Orders.none(rooms))

    @property
    def elapsed(self) -> float:
        """Simulated seconds lived so far."""
        return self._steps * STEP

    def written(self) -> dict[str, Any]:
        """Where it stands, as JSON can hold it."""
        return {
            "steps": self._steps,
            "state": self._state.tolist(),
            "memory": self._memory,
            "energy": self._energy.tolist(),
            "random": self._rng.bit_generator.state,
            "now": {name: np.asarray(value).tolist() for name, value in self.now._asdict().items()},
        }

    def go_on(self, written: Mapping[str, Any]) -> None:
        """Stand where another world of the same building and seed stood, and live on with the same numbers."""
        self._steps, self._memory = written["steps"], list(written["memory"])
        self._state, self._energy = np.array(written["state"]), np.array(written["energy"])
        self._rng.bit_generator.state = written["random"]
        now: dict[str, Any] = {
            name: np.array(value) if isinstance(value, list) else value for name, value in written["now"].items()
        }
        self.now = Snapshot(**now)

    def step(self, windows: Array, orders: Orders | None = None) -> None:
        """Live one STEP; `windows` (N,) in W/K are openings to the outside beside those of the people."""
        now = self.now
        heat = np.zeros_like(self._state)
        heat[AIR :: len(NODES)] = now.gain
        inputs = np.concatenate([[now.outdoor], now.power])
        noise = _PROCESS_NOISE_SD * self._rng.standard_normal(len(heat))
        step = self._dynamics
        self._state = step.transition @ self._state + step.input @ inputs + step.heat @ heat + noise
        self._energy = self._energy + now.power * STEP
        self._steps += 1
        self.now = self._look(windows, orders or Orders.none(len(windows)))

    def _look(self, windows: Array, orders: Orders) -> Snapshot:
        """What holds over the next step."""
        time = BEGIN + self.elapsed
        moment = self._calendar.at(time)
        air = self._state[AIR :: len(NODES)].copy()
        set_point = np.where(np.isnan(orders.set_point), moment.set_point, orders.set_point)
        power = np.empty(len(air))
        for index, (room, excess) in enumerate(zip(self.building.rooms, (air - set_point).tolist(), strict=True)):
            self._memory[index], power[index] = room.thermostat.step(self._memory[index], excess, STEP)
        opening = moment.opening + windows
        return Snapshot(
            time=FIRST_MIDNIGHT + time,
            air=air,
            envelope=self._state[ENVELOPE :: len(NODES)].copy(),
            heater=self._state[HEATER :: len(NODES)].copy(),
            set_point=set_point,
            power=np.where(np.isnan(orders.power), power, orders.power),
            energy=self._energy,
            gain=moment.gain + self._aperture * moment.irradiance + opening * (moment.outdoor - air),
            opening=opening,
            noise=SENSOR_NOISE_SD * self._rng.standard_normal(len(air) + 1),
            outdoor=moment.outdoor,
            irradiance=moment.irradiance,
        )

    def _settled(self, building: Building) -> Array:
        """Rooms at their first set-point, with walls and heaters as they would be after a long time there."""
        moment = self._calendar.at(BEGIN)
        state = np.empty(len(NODES) * len(building.rooms))
        for index, room in enumerate(building.rooms):
            theta, air = room.theta, moment.set_point[index]
            flow = (air - moment.outdoor) / (1 / theta["g_air_env"] + 1 / theta["g_env_out"])
            state[index * len(NODES) :][: len(NODES)] = (
                air,
                air - flow / theta["g_air_env"],
                air + flow / theta["g_air_heater"],
            )
        return state
