"""A building of EnergyPlus as the devices and the configuration of the BMS know it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from estimator.network.boxes import PER_AREA
from estimator.network.network import Network
from replay.bms.living.building import Room, known_network, rounded
from replay.bms.living.thermostats import PiValve
from replay.energyplus.buildings import Building

_BAND = 1.5  # K, over which the proportional part of a panel's controller covers its whole power
_INTEGRAL_TIME = 7200.0  # s
_GENERIC = {
    "C_air": "C_air",
    "C_env": "C_e",
    "C_heater": "C_h",
    "g_air_env": "g_ie",
    "g_env_out": "g_e_out",
    "g_air_heater": "g_ih",
    "g_air_out": "g_i_out",
    "A_w": "A_w",
}
"""Parameters of a room's network, and the generic ones whose range per m2 they have."""


class PlantRooms(NamedTuple):
    """The rooms of `building`, heated by panels under PI control. Their true parameters are EnergyPlus's secret."""

    building: Building

    @property
    def rooms(self) -> tuple[Room, ...]:
        """Without parameters."""
        return tuple(
            Room(room.name, PiValve(room.heater, room.heater / _BAND, _INTEGRAL_TIME), {})
            for room in self.building.rooms
        )

    def neighbours(self, index: int) -> Mapping[int, float]:
        """The rooms that share a side with room `index`; how well they conduct is not known."""
        return dict.fromkeys(self.building.neighbours(index), float("nan"))

    def zone_network(self, index: int, pace: float) -> Network:
        """The network of room `index` with boxes from its floor area, as the daemon sees it at `pace`."""
        room = self.building.rooms[index]
        boxes = {}
        for name, generic in _GENERIC.items():
            size = room.floor_area / pace if name.startswith("C_") else room.floor_area
            boxes[name] = (rounded(PER_AREA[generic].lower * size), rounded(PER_AREA[generic].upper * size))
        beside = [self.building.rooms[other].name for other in self.building.neighbours(index)]
        return known_network(room.name, boxes, beside)
