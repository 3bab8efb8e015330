"""The Thermogate configuration that reads the simulated building over Modbus, one zone per room. The daemon stamps
readings by the wall clock: at a pace of p it sees, exactly, a building in real time whose capacitances are a p-th of
the true ones, C / p dT/dt = sum of flows. Noise constants of a step are written out as for its simulated length."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w

from adapters.fields.durations import format_duration
from estimator.particle.options import Options, resolve
from replay.bms.plant import Channel, Device
from replay.bms.simulation import Simulation
from service.config.overrides import apply_overrides
from service.config.written import network_table

SIMULATED_PERIOD = 600.0
"""Length of a zone's step in simulated s, as near as whole seconds of real time allow."""

_DAY = 86_400
_PARTICLES = 3000
_POLLS_PER_PERIOD = 10
_SHORTEST_POLL = 0.2
_STUCK_PERIODS = 6
_PER_STEP = ("process_sd", "volatility_sd", "jump_probability", "shrinkage")


def write_config(path: Path, simulation: Simulation, port: int, overrides: Sequence[str] = ()) -> None:
    """Write the TOML for the Modbus server on `port`, changed by `overrides`; ConfigError for wrong ones."""
    raw = apply_overrides(configuration(simulation, port), overrides)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(_HEAD.format(pace=simulation.pace) + tomli_w.dumps(raw), encoding="utf-8")


def configuration(simulation: Simulation, port: int) -> dict[str, Any]:
    """The configuration as TOML tables: a source for every device."""
    period = zone_period(simulation.pace)
    by_room = {device.room: device for device in simulation.plant if device.room is not None}
    weather = next(device for device in simulation.plant if device.name == "weather")
    poll = max(period / _POLLS_PER_PERIOD, _SHORTEST_POLL)
    return {
        "site": {"id": "simulated-bms", "state_dir": "state"},
        "http": {"host": "127.0.0.1", "port": 8080},
        "zenoh": {"listen": ["tcp/127.0.0.1:7447"]},
        "sources": {device.name: _source(device, port, poll) for device in (weather, *by_room.values())},
        "zones": [_zone(simulation, period, index, weather, by_room) for index in by_room],
    }


def zone_period(pace: float) -> int:
    """Whole real seconds that divide a day and come nearest to SIMULATED_PERIOD from below, 1 at least."""
    longest = max(int(SIMULATED_PERIOD / pace), 1)
    return max(seconds for seconds in range(1, min(longest, _DAY) + 1) if _DAY % seconds == 0)


def _zone(
    simulation: Simulation, period: int, index: int, weather: Device, by_room: dict[int, Device]
) -> dict[str, Any]:
    building = simulation.building
    network = building.zone_network(index, simulation.pace)
    options: Options = resolve(network, period * simulation.pace, {})
    channels = {
        channel.zone_channel: _channel(_place(device, channel), channel, period)
        for device in (by_room[index], weather)
        for channel in device.channels
        if channel.zone_channel is not None
    }
    for other in building.neighbours(index):
        air = by_room[other].channel("T_air")
        assert air is not None
        channels[f"T_{building.rooms[other].name}"] = _channel(_place(by_room[other], air), air, period)
    return {
        "id": building.rooms[index].name,
        "period": format_duration(period),
        "hold_inputs": format_duration(3 * period),
        "estimator": "rbpf",
        "network": network_table(network),
        "estimator_options": {"particles": _PARTICLES} | {name: getattr(options, name) for name in _PER_STEP},
        "channels": {name: channels[name] for name in network.channels},
    }


def _source(device: Device, port: int, poll: float) -> dict[str, Any]:
    return {
        "kind": "modbus",
        "host": "127.0.0.1",
        "port": port,
        "unit_id": device.unit_id,
        "first_register": 0,
        "poll": format_duration(poll),
    }


def _place(device: Device, channel: Channel) -> dict[str, Any]:
    register = channel.register
    table: dict[str, Any] = {
        "source": device.name,
        "table": register.table,
        "register": register.address,
        "type": register.type,
    }
    if register.words > 1 or register.order != "ABCD":
        table["order"] = register.order
    if register.can_be_unavailable:
        table["not_available"] = [math.nan if register.sentinel is None else register.sentinel]
    return table | ({"scale": register.scale} if register.scale != 1.0 else {})


def _channel(place: dict[str, Any], channel: Channel, period: int) -> dict[str, Any]:
    table = dict(place)
    if channel.zone_channel == "T_air":
        # The noise of a sensor moves even a tenth of a degree sooner than that.
        table["stuck_after"] = format_duration(_STUCK_PERIODS * period)
    scale = table.pop("scale", 1.0) * channel.factor
    if scale != 1.0:
        table["scale"] = scale
    unit = "W" if channel.factor != 1.0 else channel.unit
    # Relays and valves move within a step: their mean is what heats.
    return table | {"unit": unit, "aggregate": "mean"}


_HEAD = """\
# Written by `thermogate simulate-bms --write-config`: reads a SYNTHETIC building over Modbus, one zone per room.
#
# Its pace is {pace:g}: {pace:g} simulated seconds pass in one second of the wall clock, by which the daemon stamps
# readings. What the daemon sees is therefore, exactly, a building in real time whose capacitances are 1/{pace:g} of the
# true ones: the bounds of every capacitance below are around C / {pace:g}. Conductances [W/K], powers [W] and apertures
# [m2] are the true ones. Periods are short for the same reason, and the estimator's constants per step are those of a
# step's simulated length.

"""
