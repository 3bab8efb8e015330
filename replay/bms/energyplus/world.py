"""A building of EnergyPlus that lives behind the BMS: its thermostats, its people and what its sensors add."""

from __future__ import annotations

import numpy as np

from estimator.arrays import Array
from replay.bms.energyplus.building import PlantRooms
from replay.bms.living.thermostats import Thermostats
from replay.bms.living.world import SENSOR_NOISE_SD, Orders, Snapshot
from replay.energyplus.buildings import building_named
from replay.energyplus.people import Life
from replay.energyplus.plant import STEP, Inputs, Plant


class EnergyPlusWorld:
    """The building `name` in the weather of `weather` (see `Plant`); its people follow from `seed`.

    Raises what `Plant` raises, and ReplayError where there is no such building.
    """

    step_length = STEP

    def __init__(self, name: str, weather: str, seed: int) -> None:
        building = building_named(name)
        self.building = PlantRooms(building)
        self._life = Life([room.use for room in building.rooms], STEP, seed)
        self._thermostats = Thermostats([room.thermostat for room in self.building.rooms])
        self._rng = np.random.default_rng([seed, 0xE95])
        self._plant = Plant(building, weather)
        self._steps = 0
        self._energy = np.zeros(len(building.rooms))
        self._opening = np.zeros(len(building.rooms))
        self.now = self._look(Orders.none(len(building.rooms)))

    @property
    def elapsed(self) -> float:
        """Simulated seconds lived so far."""
        return self._steps * STEP

    def step(self, windows: Array, orders: Orders) -> None:
        """Live one STEP; `windows` (N,) in W/K are openings beside those of the people, `orders` act from now on."""
        habits = self._life.at(self._plant.local_time)
        inputs = Inputs(self.now.power, *habits)._replace(opening=habits.opening + windows)
        self._plant.step(inputs)
        self._energy = self._energy + self.now.power * STEP
        self._opening = inputs.opening
        self._steps += 1
        self.now = self._look(orders)

    def close(self) -> None:
        """End EnergyPlus."""
        self._plant.close()

    def _look(self, orders: Orders) -> Snapshot:
        """The plant now, and the power until the next step."""
        now = self._plant.now
        scheduled = self._life.set_points(self._plant.local_time)
        set_point = np.where(np.isnan(orders.set_point), scheduled, orders.set_point)
        return Snapshot(
            time=now.time,
            air=now.air,
            envelope=now.radiant,
            heater=np.full(len(now.air), np.nan),
            set_point=set_point,
            power=self._thermostats.powers(now.air - set_point, orders.power, STEP),
            energy=self._energy,
            gain=now.truth.gain + now.truth.sun,
            opening=self._opening,
            noise=SENSOR_NOISE_SD * self._rng.standard_normal(len(now.air) + 1),
            outdoor=now.outdoor,
            irradiance=now.irradiance,
            flows={} if self._steps == 0 else now.truth._asdict(),
        )
