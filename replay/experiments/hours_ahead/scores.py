"""Scores of forecasts against what was measured later."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.experiments.hours_ahead.forecasts import Forecasts
from replay.scores import interval_scores, rmse


class Scores(NamedTuple):
    """Of `samples` forecasts: RMSE, CRPS, mean width and Winkler score [K], coverage as a share; NaN: not defined."""

    samples: int
    rmse: float
    crps: float
    coverage: float
    width: float
    winkler: float


ByHorizon = Mapping[str, Scores]


def score(y: Array, forecasts: Forecasts, leads: Mapping[str, int], begin: int) -> dict[str, Scores]:
    """By horizon the scores against `y` (K,) of the forecasts that were made at row `begin` or later."""
    return {name: _score(y, forecasts, place, begin + lead) for place, (name, lead) in enumerate(leads.items())}


def _score(y: Array, forecasts: Forecasts, place: int, first: int) -> Scores:
    mean, lower, upper, crps, _ = (values[first:, place] for values in forecasts)
    errors = mean - y[first:]
    intervals = interval_scores(y[first:], lower, upper)
    made = int(np.isfinite(errors).sum())
    average = float(np.nanmean(crps)) if np.isfinite(crps).any() else float("nan")
    return Scores(made, rmse(errors), average, intervals.coverage, intervals.width, intervals.winkler)


def overlapping(intervals: Array) -> Array:
    """(n,): whether the intervals (seeds, n, 2) of all seeds have a point in common."""
    return np.asarray(intervals[:, :, 0].max(axis=0) <= intervals[:, :, 1].min(axis=0))
