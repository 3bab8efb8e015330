"""Accuracy and calibration of interval forecasts (paper 3.5.3 and 3.5.4).

Two conventions give the arguments their meaning, and are never mixed:

- `one_step`: the interval of y_k that stood before y_k was seen, against y_k;
- `filtered`: the interval of the measured state after y_k was assimilated, without measurement noise, against the
  noise-free state where it is known (Ecolar: against y_k itself). The paper's authors score their runs this way.

Rows with a NaN count for nothing; without any other row the score is NaN.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array

LEVEL = 0.95
"""Nominal coverage gamma of the paper's intervals."""

Mask = npt.NDArray[np.bool_]


class IntervalScores(NamedTuple):
    """Scores of `samples` intervals: coverage as a share, width and Winkler score in K."""

    samples: int
    coverage: float
    width: float
    winkler: float


def interval_scores(y: Array, lower: Array, upper: Array, level: float = LEVEL) -> IntervalScores:
    """Coverage (36), mean width (37) and Winkler score (39) of the complete rows of y, lower and upper (K,), degC."""
    complete = ~np.isnan(y + lower + upper)
    y, lower, upper = y[complete], lower[complete], upper[complete]
    return IntervalScores(
        int(complete.sum()), coverage(y, lower, upper), mean_width(lower, upper), winkler(y, lower, upper, level)
    )


def rmse(residual: Array) -> float:
    """Root-mean-square of forecast minus reference (35), in K."""
    return float(np.sqrt(_mean(np.square(residual))))


def coverage(y: Array, lower: Array, upper: Array) -> float:
    """Share of `y` inside its interval (36), bounds included."""
    return _mean(np.where(np.isnan(y + lower + upper), np.nan, (lower <= y) & (y <= upper)))


def mean_width(lower: Array, upper: Array) -> float:
    """Mean width of the intervals (37), in K."""
    return _mean(upper - lower)


def winkler(y: Array, lower: Array, upper: Array, level: float) -> float:
    """Mean Winkler score of central intervals of nominal coverage `level` (38)-(39), in K; smaller is better."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level is {level}; a nominal coverage lies between 0 and 1")
    outside = np.maximum(lower - y, 0.0) + np.maximum(y - upper, 0.0)
    return _mean(upper - lower + 2.0 / (1.0 - level) * outside)


def pit_histogram(pit: Array, bins: int = 20) -> Array:
    """Share (bins,) of the probability integral transforms F_k(y_k) (K,) in each of `bins` equal parts of [0, 1]: 1 /
    bins where forecasts are calibrated; a U says too narrow, a hump too wide."""
    kept = pit[~np.isnan(pit)]
    counts, _ = np.histogram(kept, bins=bins, range=(0.0, 1.0))
    return counts / kept.size if kept.size else np.full(bins, np.nan)


def _mean(values: Array) -> float:
    kept = values[~np.isnan(values)]
    return float(kept.mean()) if kept.size else float("nan")
