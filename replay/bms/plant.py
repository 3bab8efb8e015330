"""The devices of the simulated plant: what each measures, and in which registers it serves that.

Three makes of room controller and a weather station differ as those of a grown plant do: in tables, types, word orders,
scales, units and in what stands for "not available".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from replay.bms.living.building import Building
from replay.bms.living.thermostats import Relay
from replay.bms.living.world import Snapshot
from replay.bms.registers import Register

WEATHER_UNIT_ID = 1
FIRST_ROOM_UNIT_ID = 11

_JOULES_PER_WATT_HOUR = 3600.0
# The first counter rolls over soon after the start, where the mistakes of its readers are.
_FIRST_READING = 2**32 - 500  # Wh

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


def devices(building: Building, *, pace: float) -> tuple[Device, ...]:
    """Weather station, and a controller per room.

    Energy counters count what flows in wall-clock time: at `pace` simulated seconds per second, a `pace`th of the heat
    of the simulated time.
    """
    rooms = [
        Device(room.name, FIRST_ROOM_UNIT_ID + k, _controller(building, k, pace), k)
        for k, room in enumerate(building.rooms)
    ]
    return (_weather_station(len(rooms)), *rooms)


def _weather_station(rooms: int) -> Device:
    def outdoor(now: Snapshot) -> float:
        return now.outdoor + float(now.noise[rooms])

    return Device(
        "weather",
        WEATHER_UNIT_ID,
        (
            Channel("T_out", "degC", Register("input", 0, "int16", scale=0.1, sentinel=-0x8000), outdoor, "T_out"),
            Channel("I_sol", "W/m2", Register("input", 1, "uint16", sentinel=0xFFFF), _sun, "I_sol"),
            Channel("T_out_F", "degF", Register("holding", 10, "float64", "DCBA"), lambda now: outdoor(now) * 1.8 + 32),
        ),
    )


def _controller(building: Building, room: int, pace: float) -> tuple[Channel, ...]:
    """What the controller of a room measures; which make it is follows from the heater and the room's place."""
    thermostat = building.rooms[room].thermostat
    if isinstance(thermostat, Relay):
        return _electric(room, pace, thermostat.power)
    return _integers(room, pace) if room % 3 == 2 else _heat_meter(room, pace, thermostat.power)


def _electric(room: int, pace: float, rated: float) -> tuple[Channel, ...]:
    """A thermostat with a relay: int16 in tenths, and the heater known from its coil and rating only."""
    return (
        Channel("T_air", "degC", Register("input", 0, "int16", scale=0.1, sentinel=-0x8000), _air(room), "T_air"),
        Channel("set_point", "degC", Register("holding", 0, "int16", scale=0.5), _set_point(room)),
        Channel("relay", "1", Register("coil", 0, "bool"), lambda now: float(now.power[room] > 0), "u_heat", rated),
        Channel("energy", "Wh", Register("input", 10, "uint32", counter=True), _energy(room, pace, _FIRST_READING)),
    )


def _heat_meter(room: int, pace: float, rated: float) -> tuple[Channel, ...]:
    """A PI valve with a heat meter: 32-bit values with the low word first."""
    return (
        Channel("T_air", "degC", Register("holding", 100, "float32", "CDAB"), _air(room), "T_air"),
        Channel(
            "heat_power", "kW", Register("holding", 102, "float32", "CDAB"), lambda now: now.power[room] / 1e3, "u_heat"
        ),
        Channel("energy", "Wh", Register("holding", 104, "uint32", "CDAB", counter=True), _energy(room, pace)),
        Channel(
            "valve",
            "%",
            Register("holding", 106, "uint16", scale=0.1),
            _valve(room, rated),
        ),
        Channel("set_point", "degC", Register("holding", 107, "int16", scale=0.1), _set_point(room)),
    )


def _integers(room: int, pace: float) -> tuple[Channel, ...]:
    """A controller that knows integers only, in K and W, and swaps the bytes of its words."""
    return (
        Channel(
            "T_air",
            "K",
            Register("input", 200, "uint16", "BADC", scale=0.01, sentinel=0xFFFF),
            lambda now: _air(room)(now) + 273.15,
            "T_air",
        ),
        Channel(
            "heat_power",
            "W",
            Register("input", 201, "int32", "BADC", sentinel=0x7FFFFFFF),
            lambda now: now.power[room],
            "u_heat",
        ),
        Channel("energy", "Wh", Register("input", 203, "uint64", "BADC", counter=True), _energy(room, pace)),
        Channel("pump", "1", Register("discrete", 3, "bool"), lambda now: float(now.power[room] > 0)),
    )


def _air(room: int) -> Read:
    return lambda now: float(now.air[room] + now.noise[room])


def _sun(now: Snapshot) -> float:
    return now.irradiance


def _valve(room: int, rated: float) -> Read:
    return lambda now: 100.0 * float(now.power[room]) / rated


def _set_point(room: int) -> Read:
    return lambda now: float(now.set_point[room])


def _energy(room: int, pace: float, first: float = 0.0) -> Read:
    return lambda now: first + float(now.energy[room]) / pace / _JOULES_PER_WATT_HOUR
