"""How far ahead forecasts go, when they are made, and which of them are scored together."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimator.arrays import Indices
from replay.experiments.series.filtering import Series
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
