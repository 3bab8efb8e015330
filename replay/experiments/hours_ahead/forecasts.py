"""Forecasts of a recording, row by row and horizon by horizon, and the two that need no model."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from estimator.arrays import Array
from replay.experiments.hours_ahead.horizons import issued
from replay.experiments.jobs import Arrays
from replay.experiments.series.filtering import Series
from replay.localtime import DAY

PERSISTENCE, YESTERDAY = "persistence", "yesterday"
_WIDE = 1.959963984540054
"""Standard deviations from the median of a normal distribution to a bound of its interval at LEVEL (.95)."""


class Forecasts(NamedTuple):
    """What was forecast of the first output at K rows, H horizons ahead: (K, H), degC and K; NaN where nothing was.

    `lower` and `upper` are the bounds of the 95 % interval; a point forecast has none, and its absolute error is its
    CRPS.
    """

    mean: Array
    lower: Array
    upper: Array
    crps: Array


class PlainRun(NamedTuple):
    """A forecast without an estimator, by name; `period` in s."""

    name: str
    series: Series
    period: float
    leads: tuple[int, ...]
    seed: int = 0


def no_forecasts(rows: int, horizons: int) -> Forecasts:
    """NaN everywhere."""
    return Forecasts(*(np.full((rows, horizons), np.nan) for _ in Forecasts._fields))


def run_naive(run: PlainRun) -> Arrays:
    """The arrays of `Forecasts`: that nothing changes, or that the next day is like the last.

    Where nothing was measured at the time in question, the last value measured before it stands in. Yesterday stands
    back behind persistence where the recording does not reach that far.
    """
    series, y = run.series, run.series.outputs[:, 0]
    last, rows = last_measured(y), np.arange(len(y))
    day_before = np.searchsorted(series.times, series.times - DAY)
    known = series.times[np.minimum(day_before, rows)] == series.times - DAY
    made = no_forecasts(len(y), len(run.leads))
    for place, lead in enumerate(run.leads):
        origin = issued(series, run.period, lead)
        target = origin + lead
        made.mean[target, place] = (
            last[origin] if run.name == PERSISTENCE else np.where(known[target], last[day_before[target]], last[origin])
        )
    made.crps[:] = np.abs(made.mean - y[:, None])
    return made._asdict()


def normal(mean: Array, sd: Array, y: Array) -> tuple[Array, Array, Array]:
    """Bounds of the 95 % interval and CRPS against `y` of normal distributions, all (n,)."""
    z = (y - mean) / sd
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    crps = sd * (z * (2 * ndtr(z) - 1) + 2 * density - 1 / np.sqrt(np.pi))
    return mean - _WIDE * sd, mean + _WIDE * sd, crps


def last_measured(y: Array) -> Array:
    """`y` (K,), whose first value is measured, with the last measured value in place of a missing one."""
    place = np.maximum.accumulate(np.where(np.isnan(y), 0, np.arange(len(y))))
    return np.asarray(y[place], dtype=np.float64)
