"""The simulated building as data: rooms in a row, each an air, envelope and heater node, walls between neighbours."""

from typing import NamedTuple

import numpy as np

from estimator.network.network import Conductance, Gain, HeatInput, InitialTemperature, Network, Parameter
from replay.bms.living.thermostats import PiValve, Relay, Thermostat

AIR, ENVELOPE, HEATER = range(3)
NODES = ("T_air", "T_env", "T_heater")

_TYPICAL = {
    "C_air": 1.3e6,
    "C_env": 1.1e7,
    "C_heater": 6e4,
    "g_air_env": 260.0,
    "g_env_out": 42.0,
    "g_air_heater": 75.0,
    "A_w": 0.5,
}
_SPREAD = 0.15  # sd of the logarithm of a room's parameters around the typical ones
_PARTITION = 25.0  # W/K between the air of two neighbours
_UNITS = {"C": "J/K", "g": "W/K", "A": "m2"}
# What one knows of a building: each parameter within a box that has the truth in it, but not in its middle.
_BELOW, _ABOVE = 6.0, 4.0
_PARTITION_BOX = (2.0, 200.0)  # W/K

ELECTRIC = Relay(power=1500.0, hysteresis=0.6)
HYDRONIC = PiValve(power=1800.0, gain=900.0, integral_time=3600.0)


class Room(NamedTuple):
    """One room: its thermostat, its true parameters by name (J/K, W/K, m2), and its place in the row."""

    name: str
    thermostat: Thermostat
    theta: dict[str, float]


class Building(NamedTuple):
    """Rooms in a row; `partitions` [W/K] tie the air of room k to that of room k + 1."""

    rooms: tuple[Room, ...]
    partitions: tuple[float, ...]

    def neighbours(self, index: int) -> dict[int, float]:
        """Conductance [W/K] to each room next to room `index`, by index."""
        found = {index - 1: self.partitions[index - 1]} if index else {}
        return found | ({index + 1: self.partitions[index]} if index + 1 < len(self.rooms) else {})

    def zone_network(self, index: int, pace: float) -> Network:
        """What can be known of room `index`, as the daemon sees it at `pace`: its neighbours' air are boundaries."""
        room = self.rooms[index]
        seen = {name: value / pace if name.startswith("C_") else value for name, value in room.theta.items()}
        neighbours = {f"T_{self.rooms[other].name}": f"g_{self.rooms[other].name}" for other in self.neighbours(index)}
        return Network(
            name=room.name,
            capacitances={node: node.replace("T_", "C_") for node in NODES},
            boundaries=("T_out", *neighbours),
            conductances=(
                Conductance("g_air_env", ("T_air", "T_env")),
                Conductance("g_env_out", ("T_env", "T_out")),
                Conductance("g_air_heater", ("T_air", "T_heater")),
                *(Conductance(name, ("T_air", boundary)) for boundary, name in neighbours.items()),
            ),
            heat_inputs=(HeatInput("u_heat", "T_heater"), HeatInput("I_sol", "T_air", Gain(parameter="A_w"), "W/m2")),
            parameters=(
                *(
                    Parameter(name, _UNITS[name[0]], _rounded(value / _BELOW), _rounded(value * _ABOVE))
                    for name, value in seen.items()
                ),
                *(Parameter(name, "W/K", *_PARTITION_BOX) for name in neighbours.values()),
            ),
            measured=("T_air",),
            initial={"T_env": InitialTemperature("measured", 5.0), "T_heater": InitialTemperature("measured", 10.0)},
        ).validate()


def design(rooms: int, seed: int) -> Building:
    """A building of `rooms` rooms: every third heated by an electric panel, the others by hot water."""
    rng = np.random.default_rng([seed, 0xB41D])
    built = []
    for index in range(rooms):
        factors = np.exp(_SPREAD * rng.standard_normal(len(_TYPICAL)))
        theta = {name: float(typical * f) for (name, typical), f in zip(_TYPICAL.items(), factors, strict=True)}
        built.append(Room(f"room{index + 1}", HYDRONIC if index % 3 else ELECTRIC, theta))
    partitions = _PARTITION * np.exp(_SPREAD * rng.standard_normal(rooms - 1))
    return Building(tuple(built), tuple(map(float, partitions)))


def whole_network(building: Building) -> tuple[Network, dict[str, float]]:
    """The network of the whole building and its true theta. States are the NODES of room after room; inputs are T_out,
    then every room's heater [W]."""
    capacitances: dict[str, str] = {}
    conductances: list[Conductance] = []
    heat: list[HeatInput] = []
    theta: dict[str, float] = {}
    for room in building.rooms:
        for node in NODES:
            capacitances[_of(room, node)] = _of(room, node.replace("T_", "C_"))
        conductances += [
            Conductance(_of(room, "g_air_env"), (_of(room, "T_air"), _of(room, "T_env"))),
            Conductance(_of(room, "g_env_out"), (_of(room, "T_env"), "T_out")),
            Conductance(_of(room, "g_air_heater"), (_of(room, "T_air"), _of(room, "T_heater"))),
        ]
        heat.append(HeatInput(_of(room, "u_heat"), _of(room, "T_heater")))
        theta |= {_of(room, name): value for name, value in room.theta.items() if name != "A_w"}
    for left, right, value in zip(building.rooms, building.rooms[1:], building.partitions, strict=False):
        name = f"g_{left.name}_{right.name}"
        conductances.append(Conductance(name, (_of(left, "T_air"), _of(right, "T_air"))))
        theta[name] = value
    return Network(
        name="simulated-building",
        capacitances=capacitances,
        boundaries=("T_out",),
        conductances=tuple(conductances),
        heat_inputs=tuple(heat),
        parameters=tuple(
            Parameter(name, _UNITS[name[0]], value / 10, value * 10, value) for name, value in theta.items()
        ),
        measured=tuple(_of(room, "T_air") for room in building.rooms),
    ).validate(), theta


def _rounded(value: float) -> float:
    """`value` with two digits, as a person would write a bound."""
    return float(f"{value:.2g}")


def _of(room: Room, name: str) -> str:
    return f"{name}_{room.name}"
