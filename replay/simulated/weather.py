"""Outdoor temperature, an annual and a diurnal cosine, the latter wider under a clear sky, and AR(1) variation, and
global irradiance, a clear sky times a stochastic cloud index, out of a seed."""

from itertools import accumulate
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from estimator.arrays import Array
from estimator.heat.sun import Location, clear_sky, sun
from replay.localtime import DAY, HOUR

YEAR = 365.2425 * DAY
SYNOPTIC_SD = 3.5  # K
SYNOPTIC_TIME = 60 * HOUR
FRONT_TIME = 20 * HOUR
CLOUD_TIME = 0.4 * HOUR
CLOUD_STEP = 300


KONSTANZ = Location(47.66, 9.18)
MEAN_TEMPERATURE, ANNUAL_AMPLITUDE = 10.0, 9.5  # degC and K


class Weather(NamedTuple):
    """Outdoor temperature (K,) in degC and global horizontal irradiance (K,) in W/m2."""

    outdoor: Array
    irradiance: Array


def weather(times: npt.NDArray[np.int64], seed: int) -> Weather:
    """Weather at ascending UTC seconds `times` (K,); the same arguments always give the same numbers."""
    rng = np.random.default_rng([seed, 0x5EA7])
    synoptic = SYNOPTIC_SD * _noise(times, HOUR, SYNOPTIC_TIME, rng)
    front = _noise(times, HOUR, FRONT_TIME, rng)
    clouds = _noise(times, CLOUD_STEP, CLOUD_TIME, rng)

    clearness = expit(0.6 + 2.0 * front)
    season = -np.cos(2 * np.pi * (times / YEAR - 20 / 365.2425))  # coldest around 20 January
    diurnal = (2.0 + 1.2 * season + 2.5 * clearness) * np.cos(2 * np.pi * (solar_time(times) - 15.0) / 24.0)
    outdoor = MEAN_TEMPERATURE + ANNUAL_AMPLITUDE * season + synoptic + diurnal
    cloud_index = 0.15 + 0.85 * expit(0.6 + 2.0 * front + 0.9 * clouds)
    return Weather(outdoor, clear_sky(sun(times[:, None].astype(np.float64), KONSTANZ)) * cloud_index)


def solar_time(times: npt.NDArray[np.int64]) -> Array:
    """Apparent solar time in h, 12 when the sun is highest."""
    position, latitude = sun(times.astype(np.float64), KONSTANZ), np.radians(KONSTANZ.latitude)
    southward = position.up * np.cos(latitude) - position.north * np.sin(latitude)
    return np.asarray(12.0 - 12.0 / np.pi * np.arctan2(position.east, southward))


def _noise(times: npt.NDArray[np.int64], step: int, time_scale: float, rng: np.random.Generator) -> Array:
    """Stationary AR(1) noise of unit variance on a grid of `step` s around `times`, interpolated linearly."""
    grid = np.arange(times[0] // step, times[-1] // step + 2) * step
    persistence = np.exp(-step / time_scale)
    innovation = np.sqrt(1.0 - persistence**2)
    shocks = rng.standard_normal(len(grid)) * innovation
    shocks[0] /= innovation
    # SciPy's `lfilter` does the same; importing `scipy.signal` takes longer than everything else that the demo imports.
    noise = accumulate(shocks.tolist(), lambda before, shock: persistence * before + shock)
    return np.interp(times, grid, list(noise))
