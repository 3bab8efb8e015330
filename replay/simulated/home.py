"""The demo: a synthetic two-zone home, its recorded telemetry and the configuration that runs it.

The living zone is the Ecolar network in the raw Ecolar layout, lived in by a family; the bedroom next to it is a TiTeTh
network with a log of its own, and its air is what the living zone has on the other side of the wall. The heat that
this wall gives back to the bedroom is left out: it is one of the gains that the bedroom's model does not know.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Literal

import numpy as np

from estimator.arrays import Array
from estimator.network.presets import ecolar, titeth
from replay.localtime import DAY, HOUR, Seconds, midnight, wall_clock
from replay.recorded.raw_telemetry import Faults, Sensor, measured
from replay.recorded.tables import cells, utc_stamps, write_table
from replay.simulated.ecolar import GRID_STEP, PANELS, WEEKDAYS, ZONE, simulate_zone, write_raw
from replay.simulated.events import Habit, habitual
from replay.simulated.heating import Heated, Loads, Panel, simulate_heated
from replay.simulated.simulate import dynamics
from replay.simulated.weather import KONSTANZ, Weather, weather

FIRST_DAY = (2025, 1, 13)
LIVING_FILE = "living-SYNTHETIC.csv"
BEDROOM_FILE = "bedroom-SYNTHETIC.csv"
CONFIGURATION_FILE = "demo.toml"

WEEKEND = (5, 6)
EVERY_DAY = (*WEEKDAYS, *WEEKEND)
LIVING_HEAT = (
    Habit(WEEKDAYS, (16.0, 23.0), 3.0, (1 * HOUR, 4 * HOUR), (100.0, 350.0)),
    Habit(WEEKEND, (9.0, 23.5), 4.0, (1 * HOUR, 5 * HOUR), (100.0, 450.0)),
    Habit(EVERY_DAY, (17.5, 20.0), 1.0, (20 * 60, 70 * 60), (600.0, 1600.0), 0.8),
)
LIVING_AIRING = (
    Habit(EVERY_DAY, (6.5, 8.5), 1.0, (5 * 60, 12 * 60), (50.0, 130.0), 0.7),
    Habit(EVERY_DAY, (18.0, 23.0), 0.7, (5 * 60, 15 * 60), (50.0, 130.0)),
)
BEDROOM_HEAT = (
    Habit(EVERY_DAY, (0.0, 7.0), 1.5, (5 * HOUR, 7 * HOUR), (70.0, 150.0)),
    Habit(EVERY_DAY, (20.0, 24.0), 1.5, (30 * 60, 3 * HOUR), (80.0, 250.0), 0.7),
)
BEDROOM_AIRING = (Habit(EVERY_DAY, (6.5, 9.0), 1.0, (5 * 60, 25 * 60), (15.0, 45.0), 0.8),)

BEDROOM_THETA = {"C_i": 1.3e6, "C_e": 1.1e7, "C_h": 1.1e5, "g_ie": 260.0, "g_e_out": 42.0, "g_ih": 75.0}
BEDROOM_PANELS = (Panel(1000.0, 0.0, 0.4, 5),)
BEDROOM_APERTURE = 0.25  # m2
PROCESS_NOISE_SD = 0.004  # K per node and minute
BEDROOM_SENSOR = Sensor(0.05, 0.05)
LIVING_FAULTS = Faults(gaps=(10 * 60, 45 * 60, 3 * HOUR), late_rows=6, missing=0.002)


def write_demo(
    directory: Path, *, days: int = 56, seed: int = 1, port: int = 8080, pace: float | Literal["max"] = 1800.0
) -> Path:
    """Write the home's telemetry and configuration into `directory` (made if need be); returns the configuration.

    `pace` is how many times faster than real time the recording streams ("max": as fast as possible), `port` where REST
    answers (0: any free one). The daemon's state goes into `directory`/state.
    """
    directory.mkdir(parents=True, exist_ok=True)
    start = midnight(*FIRST_DAY, ZONE)
    times = np.arange(start, start + days * DAY, GRID_STEP)
    local = wall_clock(times, ZONE)
    sky = weather(times, KONSTANZ, seed)
    rng = np.random.default_rng([seed, 0x40E])

    bedroom = _bedroom(sky, local, rng)
    living = simulate_zone(
        times,
        sky,
        bedroom.states[:, 0],
        set_point=_between(local, 6.0, 22.5, day=21.0, night=18.5),
        forced=np.zeros((len(times), len(PANELS)), dtype=bool),
        gain=habitual(LIVING_HEAT, local, rng),
        opening=habitual(LIVING_AIRING, local, rng),
        rng=rng,
    )
    write_raw(directory / LIVING_FILE, living, LIVING_FAULTS, seed)
    _write_bedroom(directory / BEDROOM_FILE, times, sky, bedroom, rng)
    path = directory / CONFIGURATION_FILE
    path.write_text(
        CONFIGURATION.format(
            port=port,
            pace=json.dumps(pace),
            living=LIVING_FILE,
            bedroom=BEDROOM_FILE,
            first=date(*FIRST_DAY),
            bounds="\n".join(_bounds()),
        ),
        encoding="utf-8",
    )
    return path


def _bedroom(sky: Weather, local: Seconds, rng: np.random.Generator) -> Heated:
    network = titeth()
    loads = Loads(
        set_point=_between(local, 19.0, 22.0, day=19.5, night=17.5),
        forced=np.zeros((len(local), len(BEDROOM_PANELS)), dtype=bool),
        gain=habitual(BEDROOM_HEAT, local, rng) + BEDROOM_APERTURE * sky.irradiance,
        opening=habitual(BEDROOM_AIRING, local, rng),
        noise=PROCESS_NOISE_SD * rng.standard_normal((len(local), len(network.nodes))),
    )
    step = dynamics(network, BEDROOM_THETA, GRID_STEP)
    start = np.array([18.0, 16.0, 18.0])
    return simulate_heated(network, step, sky.outdoor[:, None], loads, BEDROOM_PANELS, x0=start)


def _between(local: Seconds, begins: float, ends: float, *, day: float, night: float) -> Array:
    """Set-point (K,) in degC: `day` between two hours of the wall clock, `night` outside them."""
    hour = local % DAY / HOUR
    values: Array = np.where((hour >= begins) & (hour < ends), day, night)
    return values


def _write_bedroom(path: Path, times: Seconds, sky: Weather, bedroom: Heated, rng: np.random.Generator) -> None:
    """Once a minute, in UTC: the layout of a tidy logger, unlike the living zone's."""
    table = {
        "time": utc_stamps(times),
        "bedroom_temperature": cells(measured(BEDROOM_SENSOR, times, times, bedroom.states[:, 0], rng), 2),
        "outdoor_temperature": cells(measured(BEDROOM_SENSOR, times, times, sky.outdoor, rng), 2),
        "radiator_power": cells(bedroom.powers.sum(axis=1), 0),
    }
    write_table(path, table, list(table.values()))


def _bounds() -> Iterator[str]:
    for parameter in ecolar().parameters:
        assert parameter.nominal is not None
        yield f"{parameter.name} = {{ lower = {parameter.nominal / 5:g}, upper = {parameter.nominal * 5:g} }}"


CONFIGURATION = """\
# A SYNTHETIC home, written by `thermogate demo`: no building stands behind these numbers.
# Two zones, simulated from {first} on, with heat that no sensor sees (people, cooking, sun, open windows).
# The recording streams at many times real time; forecasts appear on REST and Zenoh as they would live.

[site]
id = "demo"
state_dir = "state"                # journal and checkpoints, next to this file
checkpoint_every = "1min"

[http]
host = "127.0.0.1"
port = {port}

[zenoh]
listen = ["tcp/127.0.0.1:7447"]

[sources.living]                   # raw layout of the Ecolar Home logger: local times, uneven rows, powers in kW
kind = "csv"
files = ["{living}"]
timestamp = {{ column = "Timestamp", format = "iso8601", zone = "Europe/Berlin" }}
pace = {pace}

[sources.bedroom]                  # a tidy logger: once a minute, in UTC, power in W
kind = "csv"
files = ["{bedroom}"]
timestamp = {{ column = "time", format = "iso8601" }}
pace = {pace}

[[zones]]
id = "living"
period = "5min"
estimator = "rbpf"

[zones.network]
preset = "ecolar-6r4c"

# What one knows of a building narrows the search: here each parameter to a factor of five around the preset's value.
[zones.network.parameters]
{bounds}

[zones.estimator_options]
particles = 3000

[zones.channels]
T_air = {{ source = "living", column = "Temp2", unit = "degC" }}
T_out = {{ source = "living", column = "Sensor_outside", unit = "degC" }}
T_adj = {{ source = "living", column = "Other_room_temp", unit = "degC" }}
u_heat = {{ source = "living", columns = ["my-pv1", "my-pv2", "my-pv3", "Relay 4", "Relay 5"], unit = "kW" }}

[[zones]]
id = "bedroom"
period = "5min"
network = "titeth"
estimator = "rbpf"

[zones.estimator_options]
particles = 3000

[zones.channels]
T_i = {{ source = "bedroom", column = "bedroom_temperature", unit = "degC" }}
T_out = {{ source = "bedroom", column = "outdoor_temperature", unit = "degC" }}
u_heat = {{ source = "bedroom", column = "radiator_power", unit = "W" }}
"""
