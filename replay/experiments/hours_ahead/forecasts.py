"""Forecasts of a recording, row by row and horizon by horizon, and the two that need no model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.experiments.hours_ahead.horizons import issued
from replay.experiments.series.filtering import Series
from replay.localtime import DAY

PERSISTENCE, PREVIOUS_DAY = "persistence", "previous day"


class Forecasts(NamedTuple):
    """What was forecast of the first output at K rows, H horizons ahead: (K, H), degC and K; NaN where nothing was.

    `lower` and `upper` are the bounds of the 95 % interval, `pit` is F(y); a point forecast has none of them, and its
    absolute error is its CRPS.
    """

    mean: Array
    lower: Array
    upper: Array
    crps: Array
    pit: Array


def no_forecasts(rows: int, horizons: int) -> Forecasts:
    """NaN everywhere."""
    return Forecasts(*(np.full((rows, horizons), np.nan) for _ in Forecasts._fields))


def point_forecasts(series: Series, period: float, leads: Sequence[int]) -> Mapping[str, Forecasts]:
    """That nothing changes, and that the next day is like the last: (K, H) at `leads` (H,).

    Where nothing was measured at the time in question, the last value measured before it stands in. The previous day
    stands back behind persistence where the recording does not reach that far.
    """
    y = series.outputs[:, 0]
    last = _last_measured(y)
    rows = np.arange(len(y))
    day_before = np.searchsorted(series.times, series.times - DAY)
    known = series.times[np.minimum(day_before, rows)] == series.times - DAY
    made = {name: no_forecasts(len(y), len(leads)) for name in (PERSISTENCE, PREVIOUS_DAY)}
    for place, lead in enumerate(leads):
        origin = issued(series, period, lead)
        target = origin + lead
        made[PERSISTENCE].mean[target, place] = last[origin]
        made[PREVIOUS_DAY].mean[target, place] = np.where(known[target], last[day_before[target]], last[origin])
    for forecasts in made.values():
        forecasts.crps[:] = np.abs(forecasts.mean - y[:, None])
    return made


def _last_measured(y: Array) -> Array:
    """`y` (K,), whose first value is measured, with the last measured value in place of a missing one."""
    place = np.maximum.accumulate(np.where(np.isnan(y), 0, np.arange(len(y))))
    return np.asarray(y[place], dtype=np.float64)
