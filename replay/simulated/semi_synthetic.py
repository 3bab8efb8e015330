"""The semi-synthetic testbed of paper 4.2: building 67, real or generated weather, a known unmeasured gain."""

import csv
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array
from estimator.network.presets import PRESETS
from replay.errors import WeatherFileError
from replay.localtime import DAY, Seconds, midnight
from replay.simulated.events import HEATER, UNMEASURED_GAIN, square_wave
from replay.simulated.simulate import simulate
from replay.simulated.weather import Weather, weather

PERIOD = 600
PROCESS_NOISE_SD = 0.03
MEASUREMENT_NOISE_SD = 0.15
START_TEMPERATURE = 20.0
FULL_DAYS = 154  # 10 April to 10 September
WEATHER_COLUMNS = ("timestamp_utc", "T_out_degC", "GHI_W_m2")


class Truth(NamedTuple):
    """What no estimator is told: `states` (K, n_x) in degC; `unmeasured_gain` (K,) in W into the first measured node
    over [t_k, t_k + period); `disturbance_dominated` (K,), whether it acted during the interval that ends at t_k."""

    states: Array
    unmeasured_gain: Array
    disturbance_dominated: npt.NDArray[np.bool_]


class Recording(NamedTuple):
    """A simulated period: UTC seconds (K,), the network's channels (K,) by name, and the truth."""

    times: Seconds
    columns: dict[str, Array]
    truth: Truth


def generate(weather_csv: Path | None, *, days: int | None = None, seed: int) -> Recording:
    """Simulate building 67 over the weather of `weather_csv` (None: the built-in weather from 10 April 2024), or over
    its first `days`. One seed gives one heater sequence, one gain and one noise sequence whatever the weather. Raises
    WeatherFileError."""
    times, (outdoor, irradiance) = _weather(weather_csv, seed)
    if days is not None:
        keep = days * DAY // PERIOD
        times, outdoor, irradiance = times[:keep], outdoor[:keep], irradiance[:keep]
    heating, disturbing, process, measurement = (np.random.default_rng([seed, role]) for role in range(4))
    heater = square_wave(HEATER, len(times), PERIOD, heating)
    gain = square_wave(UNMEASURED_GAIN, len(times), PERIOD, disturbing)

    network = PRESETS["building-67"]
    given = {"T_out": outdoor, "u_heat": heater, "I_sol": irradiance}
    unmeasured = np.zeros((len(times), len(network.nodes)))
    unmeasured[:, network.nodes.index(network.measured[0])] = gain
    states = simulate(
        network,
        {},
        np.column_stack([given[channel] for channel in network.inputs]),
        PERIOD,
        x0=np.full(len(network.nodes), START_TEMPERATURE),
        process_noise_sd=PROCESS_NOISE_SD,
        unmeasured=unmeasured,
        rng=process,
    )
    noise = MEASUREMENT_NOISE_SD * measurement.standard_normal((len(network.measured), len(times)))
    measured = {
        node: states[:, network.nodes.index(node)] + row for node, row in zip(network.measured, noise, strict=True)
    }
    acted = np.concatenate([[False], gain[:-1] > 0.0])
    return Recording(times, measured | given, Truth(states, gain, acted))


def _weather(path: Path | None, seed: int) -> tuple[Seconds, Weather]:
    if path is not None:
        return read_weather(path)
    times = midnight(2024, 4, 10, "UTC") + PERIOD * np.arange(FULL_DAYS * DAY // PERIOD)
    # Rounded as weather files are.
    return times, Weather(*(np.round(values, 3) for values in weather(times, seed)))


def _utc(text: str) -> int:
    """UTC seconds since 1970 of an ISO 8601 time, which is UTC unless it says another offset."""
    when = datetime.fromisoformat(text)
    return round((when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp())


def read_weather(path: Path) -> tuple[Seconds, Weather]:
    """Times and weather of a CSV file with WEATHER_COLUMNS, one row every 600 s; WeatherFileError."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [[row[name] for name in WEATHER_COLUMNS] for row in csv.DictReader(file)]
        times = np.array([_utc(row[0]) for row in rows], dtype=np.int64)
        values = np.array([row[1:] for row in rows], dtype=np.float64).reshape(-1, 2)
    except OSError as error:
        raise WeatherFileError(f"{path}: cannot be read ({error.strerror}); give the path of a weather file") from error
    except KeyError as error:
        raise WeatherFileError(
            f"{path}: column {error} is missing; the file needs {', '.join(WEATHER_COLUMNS)}"
        ) from error
    except (ValueError, TypeError) as error:
        raise WeatherFileError(
            f"{path}: a cell is not a time or a number ({error}); correct or drop that row"
        ) from error
    if len(times) < 2 or (np.diff(times) != PERIOD).any() or not np.isfinite(values).all():
        raise WeatherFileError(f"{path}: the rows are not {PERIOD} s apart without a gap; resample the file")
    return times, Weather(values[:, 0], values[:, 1])
