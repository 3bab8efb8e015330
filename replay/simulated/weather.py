"""Outdoor temperature and global horizontal irradiance out of a seed, for simulated periods without a weather file.

Temperature: annual and diurnal cosine, the latter wider under a clear sky, plus AR(1) synoptic variation. Irradiance:
Haurwitz' clear sky (Haurwitz 1945, J. Meteorology 2:154-166, in the form of Reno, Hansen and Stein 2012, SAND2012-2389)
over solar geometry after Spencer (1971, Search 2:172), times a stochastic cloud index.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter
from scipy.special import expit

from estimator.arrays import Array
from replay.localtime import DAY, HOUR

YEAR = 365.2425 * DAY
SYNOPTIC_SD = 3.5  # K
SYNOPTIC_TIME = 60 * HOUR
FRONT_TIME = 20 * HOUR
CLOUD_TIME = 0.4 * HOUR
CLOUD_STEP = 300


class Site(NamedTuple):
    """Where the weather happens: degrees north and east, annual mean [degC] and amplitude [K] of the temperature."""

    latitude: float
    longitude: float
    mean_temperature: float = 10.0
    annual_amplitude: float = 9.5


KONSTANZ = Site(47.66, 9.18)


class Weather(NamedTuple):
    """Outdoor temperature (K,) in degC and global horizontal irradiance (K,) in W/m2."""

    outdoor: Array
    irradiance: Array


def weather(times: npt.NDArray[np.int64], site: Site = KONSTANZ, seed: int = 0) -> Weather:
    """Weather at ascending UTC seconds `times` (K,); the same arguments always give the same numbers."""
    rng = np.random.default_rng([seed, 0x5EA7])
    synoptic = SYNOPTIC_SD * _noise(times, HOUR, SYNOPTIC_TIME, rng)
    front = _noise(times, HOUR, FRONT_TIME, rng)
    clouds = _noise(times, CLOUD_STEP, CLOUD_TIME, rng)

    clearness = expit(0.6 + 2.0 * front)
    season = -np.cos(2 * np.pi * (times / YEAR - 20 / 365.2425))  # coldest around 20 January
    diurnal = (2.0 + 1.2 * season + 2.5 * clearness) * np.cos(2 * np.pi * (solar_time(times, site) - 15.0) / 24.0)
    outdoor = site.mean_temperature + site.annual_amplitude * season + synoptic + diurnal
    cloud_index = 0.15 + 0.85 * expit(0.6 + 2.0 * front + 0.9 * clouds)
    return Weather(outdoor, clear_sky(times, site) * cloud_index)


def clear_sky(times: npt.NDArray[np.int64], site: Site = KONSTANZ) -> Array:
    """Clear-sky global horizontal irradiance [W/m2] after Haurwitz, at UTC seconds `times` (K,)."""
    height = cos_zenith(times, site)
    up = np.maximum(height, 1e-3)
    return np.where(height > 0, 1098.0 * up * np.exp(-0.059 / up), 0.0)


def cos_zenith(times: npt.NDArray[np.int64], site: Site = KONSTANZ) -> Array:
    """Cosine of the sun's zenith angle; negative below the horizon."""
    angle = 2 * np.pi * times / YEAR
    declination = (
        0.006918
        - 0.399912 * np.cos(angle)
        + 0.070257 * np.sin(angle)
        - 0.006758 * np.cos(2 * angle)
        + 0.000907 * np.sin(2 * angle)
        - 0.002697 * np.cos(3 * angle)
        + 0.00148 * np.sin(3 * angle)
    )
    latitude = np.radians(site.latitude)
    hour_angle = np.pi * (solar_time(times, site) - 12.0) / 12.0
    height: Array = np.sin(latitude) * np.sin(declination) + np.cos(latitude) * np.cos(declination) * np.cos(hour_angle)
    return height


def solar_time(times: npt.NDArray[np.int64], site: Site = KONSTANZ) -> Array:
    """Apparent solar time in h, 12 when the sun is highest."""
    angle = 2 * np.pi * times / YEAR
    equation_of_time = 229.18 * (  # min
        0.000075
        + 0.001868 * np.cos(angle)
        - 0.032077 * np.sin(angle)
        - 0.014615 * np.cos(2 * angle)
        - 0.04089 * np.sin(2 * angle)
    )
    hours: Array = (times % DAY / HOUR + site.longitude / 15.0 + equation_of_time / 60.0) % 24.0
    return hours


def _noise(times: npt.NDArray[np.int64], step: int, time_scale: float, rng: np.random.Generator) -> Array:
    """Stationary AR(1) noise of unit variance on a grid of `step` s around `times`, interpolated linearly."""
    grid = np.arange(times[0] // step, times[-1] // step + 2) * step
    persistence = np.exp(-step / time_scale)
    innovation = np.sqrt(1.0 - persistence**2)
    shocks = rng.standard_normal(len(grid)) * innovation
    shocks[0] /= innovation
    return np.interp(times, grid, lfilter([1.0], [1.0, -persistence], shocks))
