"""What the errors of the one-step forecasts still tell: their place in the forecast, their memory, and inputs."""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from estimator.arrays import Array
from replay.localtime import HOUR
from replay.recorded.trace import Trace

REACH = 6 * HOUR
"""Longest lag [s]."""


class Diagnostics(NamedTuple):
    """Of R residuals on the grid: `pit` (R,), where each measurement fell in the Gaussian with the forecast's mean and
    standard deviation; at `lags` (L,) [s], from one step to REACH, `autocorrelation` (L,), and by channel correlation
    with the input (1 + L,), from no lag on, NaN where nothing varies; `band`: white noise is beyond once in twenty."""

    pit: Array
    lags: Array
    autocorrelation: Array
    against_inputs: dict[str, Array]
    band: float


def diagnostics(trace: Trace) -> Diagnostics:
    """The diagnostics of `trace`; only samples that stand apart by the lag are compared, never across a gap."""
    rows, period = trace.rows, trace.period
    slots = np.array([row.time for row in rows], dtype=np.int64) // period
    slots -= slots[0] if len(slots) else 0
    size = int(slots[-1]) + 1 if len(slots) else 0
    residual, sd = np.full(size, np.nan), np.full(size, np.nan)
    residual[slots], sd[slots] = [row.residual for row in rows], [row.sd for row in rows]
    known = np.isfinite(residual)
    steps = np.arange(1, max(1, REACH // period) + 1)
    against = {}
    for place, channel in enumerate(trace.network.inputs):
        values = np.full(size, np.nan)
        # The inputs in force before a sample are those of the step that led to it.
        values[slots[1:]] = trace.inputs[:-1, place]
        against[channel] = np.array([correlation(residual, values, lag) for lag in (0, *steps.tolist())])
    return Diagnostics(
        pit=ndtr(residual[known] / sd[known]),
        lags=(steps * period).astype(np.float64),
        autocorrelation=np.array([correlation(residual, residual, lag) for lag in steps.tolist()]),
        against_inputs=against,
        band=float(1.96 / np.sqrt(max(1, known.sum()))),
    )


def correlation(later: Array, earlier: Array, lag: int) -> float:
    """Pearson correlation of `later` (K,) with `earlier` (K,) `lag` steps before it, over the complete pairs."""
    if lag >= len(later):
        return float("nan")
    a, b = later[lag:], earlier[: len(earlier) - lag]
    complete = np.isfinite(a) & np.isfinite(b)
    a, b = a[complete], b[complete]
    if len(a) < 3 or not (np.ptp(a) > 0.0 and np.ptp(b) > 0.0):
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])
