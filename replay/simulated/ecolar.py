"""Synthetic stand-ins for the unpublished Ecolar Home recordings (paper 4.3), in their raw column layout.

The zone is the 6R4C network with parameters near the published starting point, infrared heaters behind relays, an
adjacent store room that the sun heats, staff who come irregularly on weekdays, and sun through a partly shaded façade
that no sensor sees.
"""

import argparse
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Parameter
from estimator.network.presets import PRESETS
from replay.localtime import DAY, HOUR, Seconds, midnight, wall_clock
from replay.recorded import raw_telemetry
from replay.recorded.raw_telemetry import Faults, Sensor
from replay.recorded.tables import cells, local_stamps, write_table
from replay.simulated.events import WEEKDAYS, Habit, SquareWave, habitual, square_wave
from replay.simulated.heating import Heated, Loads, Panel, simulate_heated
from replay.simulated.simulate import dynamics, simulate
from replay.simulated.weather import Weather, solar_time, weather

_DATA = tomllib.loads(files(__package__).joinpath("ecolar.toml").read_text(encoding="utf-8"))
ZONE = "Europe/Berlin"
HEATER_COLUMNS = tuple(_DATA["panels"])
COLUMNS = ("Timestamp", "Temp2", "Sensor_outside", "Other_room_temp", *HEATER_COLUMNS)
GRID_STEP = 60

Period = Literal["spring", "autumn"]
Day = tuple[int, int, int]

PERIODS: dict[Period, tuple[Day, Day]] = _DATA["periods"]
FAULTS = Faults(gaps=(8 * 60, 25 * 60, 70 * 60, 5 * HOUR, DAY), late_rows=12, missing=0.003)
THETA: Mapping[str, float] = _DATA["theta"]
PANELS = tuple(Panel(*row) for row in _DATA["panels"].values())
EXPERIMENT = SquareWave(1.0, 0.004, 1 * HOUR, 4 * HOUR)
PROCESS_NOISE_SD = 0.004  # K per node and minute
ADJACENT_ROOM = PRESETS["tite"].with_solar("T_i", Parameter("A_w", "m2", 0.1, 30.0))
STAFF, DOORS = (tuple(Habit(WEEKDAYS, *row) for row in rows) for rows in _DATA["habits"].values())
AIR_SENSOR = Sensor(0.06, 0.1)
OUTDOOR_SENSOR = Sensor(0.08, 0.1)


class ZonePeriod(NamedTuple):
    """A simulated period of a zone on a grid of GRID_STEP s: UTC seconds (K,), degC (K,), and the closed loop."""

    times: Seconds
    outdoor: Array
    adjacent: Array
    heated: Heated

    @property
    def air(self) -> Array:
        """Indoor-air temperature (K,) in degC."""
        return self.heated.states[:, 0]


def write_standin(path: Path, period: Period, seed: int = 2) -> Path:
    """Write the stand-in for 3 May-1 Jun ("spring") or 3 Oct-20 Nov ("autumn") 2025 and return its path; ValueError
    unless its name says "synthetic", for which the layout has no room."""
    if "synthetic" not in path.name.lower():
        raise ValueError(f"{path.name}: a stand-in for a recording needs 'synthetic' in its name")
    first, last = PERIODS[period]
    return write_raw(path, simulate_period(midnight(*first, ZONE), midnight(*last, ZONE), seed), FAULTS, seed)


def simulate_period(start: int, end: int, seed: int) -> ZonePeriod:
    """Ecolar Home from UTC second `start` to before `end`; sun through the façade adds to what people bring."""
    times = np.arange(start, end, GRID_STEP)
    local = wall_clock(times, ZONE)
    sky = weather(times, seed)
    adjacent = _adjacent_room(sky)
    rng = np.random.default_rng([seed, 0xEC0])
    network = PRESETS["ecolar-6r4c"]
    forced = np.column_stack([square_wave(EXPERIMENT, len(times), GRID_STEP, rng) > 0 for _ in PANELS])
    loads = Loads(
        set_point=_set_points(local, rng),
        forced=forced,
        gain=habitual(STAFF, local, rng) + facade_aperture(times) * sky.irradiance,
        opening=habitual(DOORS, local, rng),
        noise=PROCESS_NOISE_SD * rng.standard_normal((len(times), len(network.nodes))),
    )
    outside_wall = _between(20.0, sky.outdoor[0], THETA["g_air_wo"], THETA["g_wo_out"])
    adjacent_wall = _between(20.0, adjacent[0], THETA["g_air_wi"], THETA["g_wi_adj"])
    first = np.array([20.0, outside_wall, adjacent_wall, 20.0])
    boundaries = np.column_stack([sky.outdoor, adjacent])
    heated = simulate_heated(network, dynamics(network, THETA, GRID_STEP), boundaries, loads, PANELS, x0=first)
    return ZonePeriod(times, sky.outdoor, adjacent, heated)


def facade_aperture(times: Seconds) -> Array:
    """Effective solar aperture [m2] over the day."""
    return np.interp(solar_time(times), _DATA["facade"]["hour"], _DATA["facade"]["aperture"])


def write_raw(path: Path, period: ZonePeriod, faults: Faults, seed: int) -> Path:
    """Write `period` as the building's logger would have: raw Ecolar layout, local times, powers in kW."""
    rng = np.random.default_rng([seed, 0x109])
    grid = period.times
    times = raw_telemetry.row_times(int(grid[0]), int(grid[-1]) + GRID_STEP, (10, 60), rng)
    temperatures = [
        raw_telemetry.measured(AIR_SENSOR, times, grid, period.air, rng),
        raw_telemetry.measured(OUTDOOR_SENSOR, times, grid, period.outdoor, rng),
        raw_telemetry.measured(AIR_SENSOR, times, grid, period.adjacent, rng),
    ]
    silent = int(rng.uniform(times[0], times[-1] - 3 * HOUR))
    temperatures[2] = raw_telemetry.with_outage(temperatures[2], times, silent, 2 * HOUR)
    kilowatts = raw_telemetry.switched(times, grid, period.heated.powers) / 1000.0
    kilowatts[:, :3] *= 1.0 + 0.004 * rng.standard_normal((len(times), 3))  # metered; the relays log their rating
    rows = raw_telemetry.kept_rows(times, faults, ZONE, rng)
    columns = [local_stamps(wall_clock(times, ZONE)[rows])]
    columns += [cells(raw_telemetry.with_missing(values, faults.missing, rng)[rows], 1) for values in temperatures]
    columns += [cells(raw_telemetry.with_missing(values, faults.missing, rng)[rows], 3) for values in kilowatts.T]
    return write_table(path, dict(zip(COLUMNS, columns, strict=True)))


def _between(inside: float, outside: float, inner: float, outer: float) -> float:
    """Steady temperature of a wall node tied to both sides by conductances `inner` and `outer`."""
    return (inner * inside + outer * outside) / (inner + outer)


def _adjacent_room(sky: Weather) -> Array:
    """Air temperature (K,) of the closed, unventilated room next door, which the sun heats."""
    given = {"T_out": sky.outdoor, "u_heat": np.zeros_like(sky.outdoor), "I_sol": sky.irradiance}
    inputs = np.column_stack([given[channel] for channel in ADJACENT_ROOM.inputs])
    start = np.full(len(ADJACENT_ROOM.nodes), sky.outdoor[:1].mean() + 4.0)
    return simulate(ADJACENT_ROOM, _DATA["adjacent_theta"], inputs, GRID_STEP, x0=start)[:, 0]


def _set_points(local: Seconds, rng: np.random.Generator) -> Array:
    """Set-point (K,) in degC at wall-clock seconds `local`: a value by day and one by night, new every day."""
    day = local // DAY - local[0] // DAY
    count = int(day[-1]) + 1
    by_day, by_night = rng.uniform(20.5, 22.5, count), rng.uniform(18.5, 20.5, count)
    begins, ends = rng.uniform(5.0, 7.5, count), rng.uniform(17.0, 20.0, count)
    hour = local % DAY / HOUR
    return np.where((hour >= begins[day]) & (hour < ends[day]), by_day[day], by_night[day])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m replay.simulated.ecolar", description=__doc__)
    parser.add_argument("directory", type=Path, help="folder to write into")
    directory = parser.parse_args().directory
    directory.mkdir(parents=True, exist_ok=True)
    for period in ("spring", "autumn"):
        print(write_standin(directory / f"ecolar-{period}-SYNTHETIC.csv", period))


if __name__ == "__main__":
    main()
