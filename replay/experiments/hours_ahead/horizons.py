"""How far ahead forecasts go, when they are made, and from when on they are scored."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimator.arrays import Indices
from replay.experiments.series.filtering import Series
from replay.localtime import DAY, HOUR

ONE_STEP = "1 step"
AHEAD = {"1 h": HOUR, "6 h": 6 * HOUR, "24 h": DAY}
"""Horizons beside one step [s]."""
EVERY = 2 * HOUR
"""Time from one forecast of the hours ahead to the next [s]; one step ahead is forecast at every step."""

THREE_DAYS, SHARE = "after three days", "after 30 %"
WINDOWS = (THREE_DAYS, SHARE)
"""From when on forecasts count. The targets are set for the first."""


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


def scored_from(series: Series) -> Mapping[str, int]:
    """The first row by window. Half of a record counts if three days leave less than a quarter of it."""
    count = len(series.times)
    after_three_days = int(np.searchsorted(series.times, series.times[0] + 3 * DAY))
    return {
        THREE_DAYS: after_three_days if after_three_days <= 0.75 * count else count // 2,
        SHARE: int(0.3 * count),
    }
