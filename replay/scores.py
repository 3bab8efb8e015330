"""Scores of forecasts (paper 3.5.3 and 3.5.4).

Rows with a NaN count for nothing; without any other row the score is NaN.
"""

from __future__ import annotations

import numpy as np

from estimator.types import Array


def rmse(residual: Array) -> float:
    """Root-mean-square of forecast minus reference (35), in K."""
    return float(np.sqrt(_mean(np.square(residual))))


def coverage(y: Array, lower: Array, upper: Array) -> float:
    """Share of `y` inside its interval (36), bounds included."""
    inside = np.where(np.isnan(y + lower + upper), np.nan, (lower <= y) & (y <= upper))
    return _mean(inside)


def mean_width(lower: Array, upper: Array) -> float:
    """Mean width of the intervals (37), in K."""
    return _mean(upper - lower)


def winkler(y: Array, lower: Array, upper: Array, level: float) -> float:
    """Mean Winkler score of central intervals of nominal coverage `level` (38)-(39), in K; smaller is better."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level is {level}; a nominal coverage lies between 0 and 1")
    outside = np.maximum(lower - y, 0.0) + np.maximum(y - upper, 0.0)
    return _mean(upper - lower + 2.0 / (1.0 - level) * outside)


def _mean(values: Array) -> float:
    kept = values[~np.isnan(values)]
    return float(kept.mean()) if kept.size else float("nan")
