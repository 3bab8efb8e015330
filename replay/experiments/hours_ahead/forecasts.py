"""Forecasts of a recording, row by row and horizon by horizon: when they are made, and the two that need no model."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array, Indices
from replay.experiments.jobs import Arrays
from replay.experiments.series.filtering import Series
from replay.experiments.series.recorded_zone import held
from replay.localtime import DAY, HOUR
from replay.scores.windows import Window

ONE_STEP = "1 step"
AHEAD = {"1 h": HOUR, "6 h": 6 * HOUR, "24 h": DAY}
"""Horizons beside one step [s]."""
EVERY = 2 * HOUR
"""Time from one forecast of the hours ahead to the next [s]; one step ahead is forecast at every step."""

FIRST_DAYS, LATER = "first three days", "after three days"
WINDOWS = (FIRST_DAYS, LATER)
"""Which forecasts are scored together: those made and come true in the first three days, and those made later."""


def leads_of(period: float) -> dict[str, int]:
    """Steps ahead of every horizon by name; a horizon that is one step long, or shorter, appears once."""
    leads = {name: round(seconds / period) for name, seconds in AHEAD.items()}
    return {ONE_STEP: 1} | {name: lead for name, lead in leads.items() if lead > 1}


def issued(series: Series, period: float, lead: int) -> Indices:
    """Rows after whose sample a forecast `lead` steps ahead is made: those whose segment goes on long enough."""
    rows = np.arange(len(series.times))
    if lead > 1:
        rows = rows[:: max(1, round(EVERY / period))]
    segment = np.cumsum(series.starts)
    rows = rows[rows + lead < len(segment)]
    return np.asarray(rows[segment[rows] == segment[rows + lead]], dtype=np.int64)


def windows_of(series: Series) -> Mapping[str, Window]:
    """The rows of each window. The first days end at half of a record of which three days leave less than a quarter."""
    count = len(series.times)
    third = int(np.searchsorted(series.times, series.times[0] + 3 * DAY))
    first = third if third <= 0.75 * count else count // 2
    return {FIRST_DAYS: Window(0, first), LATER: Window(first, count)}


PERSISTENCE, YESTERDAY = "persistence", "yesterday"
WIDE = 1.959963984540054
"""Standard deviations from the median of a normal distribution to a bound of its interval at LEVEL (.95)."""


class Forecasts(NamedTuple):
    """What was forecast of the first output at K rows, H horizons ahead: (K, H), degC and K; NaN where nothing was. A
    point forecast has no bounds of the 95 % interval, and its absolute error as CRPS."""

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


def last_measured(y: Array) -> Array:
    """`y` (K,), whose first value is measured, with the last measured value in place of a missing one."""
    return held(np.arange(len(y)), y, np.inf)
