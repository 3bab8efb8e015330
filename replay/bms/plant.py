"""The devices of the simulated plant: what each measures, and in which registers it serves that.

Three makes of room controller and a weather station differ as those of a grown plant do: in tables, types, word orders,
scales, units and in what stands for "not available". `plant.toml` has them as data.
"""

import tomllib
from collections.abc import Callable, Mapping
from functools import partial
from importlib.resources import files
from typing import Any, NamedTuple

from replay.bms.living.building import Building
from replay.bms.living.thermostats import Relay
from replay.bms.living.world import Snapshot
from replay.bms.registers import Register

WEATHER_UNIT_ID = 1
FIRST_ROOM_UNIT_ID = 11

Read = Callable[[Snapshot], float]


class Channel(NamedTuple):
    """One measured value of a device, in `unit`; `zone_channel` is what a zone's network calls it, if it needs it."""

    name: str
    unit: str
    register: Register
    read: Read
    zone_channel: str | None = None
    factor: float = 1.0
    """Watts, or degC, per unit of the value for the zone's network: the power behind a relay."""


class Device(NamedTuple):
    """A Modbus device behind its unit id; `room` is the index of the room it serves."""

    name: str
    unit_id: int
    channels: tuple[Channel, ...]
    room: int | None = None

    def channel(self, name: str) -> Channel | None:
        """The channel called `name`."""
        return next((channel for channel in self.channels if channel.name == name), None)


class _Room(NamedTuple):
    """Where a controller is: the index of its room, the rated power [W], and the pace."""

    place: int
    rated: float
    pace: float


def devices(building: Building, *, pace: float) -> tuple[Device, ...]:
    """Weather station, and a controller per room.

    Energy counters count what flows in wall-clock time: at `pace` simulated seconds per second, a `pace`th of the heat
    of the simulated time.
    """
    found = [Device("weather", WEATHER_UNIT_ID, _channels("weather", _Room(0, 0.0, pace)))]
    for index, room in enumerate(building.rooms):
        relay = isinstance(room.thermostat, Relay)
        make = "electric" if relay else "integers" if index % 3 == 2 else "heat-meter"
        channels = _channels(make, _Room(index, room.thermostat.power, pace))
        found.append(Device(room.name, FIRST_ROOM_UNIT_ID + index, channels, index))
    return tuple(found)


def _channels(make: str, room: _Room) -> tuple[Channel, ...]:
    found = []
    for row in _MAKES[make]:
        given = dict(row)
        name, unit, reads, wanted = (given.pop(key, None) for key in ("name", "unit", "reads", "zone_channel"))
        factor = room.rated if wanted == "u_heat" and given["type"] == "bool" else 1.0
        found.append(Channel(name, unit, Register(**given), partial(_READS[reads], room), wanted, factor))
    return tuple(found)


_MAKES: Mapping[str, list[dict[str, Any]]] = tomllib.loads(
    files(__package__).joinpath("plant.toml").read_text(encoding="utf-8")
)


def _outdoor(room: _Room, now: Snapshot) -> float:
    return now.outdoor + float(now.noise[-1])


def _air(room: _Room, now: Snapshot) -> float:
    return float(now.air[room.place] + now.noise[room.place])


def _power(room: _Room, now: Snapshot) -> float:
    return float(now.power[room.place])


def _energy(room: _Room, now: Snapshot) -> float:
    return float(now.energy[room.place]) / room.pace / 3600.0


_READS: Mapping[str, Callable[[_Room, Snapshot], float]] = {
    "outdoor": _outdoor,
    "outdoor in degF": lambda room, now: _outdoor(room, now) * 1.8 + 32,
    "sun": lambda room, now: now.irradiance,
    "air": _air,
    "air in K": lambda room, now: _air(room, now) + 273.15,
    "set-point": lambda room, now: float(now.set_point[room.place]),
    "power": _power,
    "power in kW": lambda room, now: _power(room, now) / 1e3,
    "on": lambda room, now: float(_power(room, now) > 0),
    "valve": lambda room, now: 100.0 * _power(room, now) / room.rated,
    "energy": _energy,
    # It rolls over soon after the start, where the mistakes of its readers are.
    "energy, soon over": lambda room, now: 2**32 - 500 + _energy(room, now),
}
