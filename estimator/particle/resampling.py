"""Weights, effective sample size and systematic resampling (Algorithm 1, lines 11 and 14)."""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array, Indices


class Weighted(NamedTuple):
    """Normalised log weights (N,), the weights (N,), the log of the sum that was divided by, and N_eff."""

    log_weights: Array
    weights: Array
    log_sum: float
    effective_sample_size: float


def reweigh(log_weights: Array) -> Weighted:
    """Normalise `log_weights` (N,), not all of them -inf; not-a-number counts as -inf.

    A particle whose numbers broke down explains nothing; it must not speak for the others.
    """
    highest = float(np.fmax.reduce(log_weights))
    finite = log_weights if np.isfinite(log_weights.sum()) else np.where(np.isnan(log_weights), -np.inf, log_weights)
    log_sum = highest + float(np.log(np.exp(finite - highest).sum()))
    normalised = finite - log_sum
    weights = np.exp(normalised)
    return Weighted(normalised, weights, log_sum, effective_sample_size(weights))


def effective_sample_size(weights: Array) -> float:
    """N_eff = 1 / sum w_i^2 of normalised `weights` (N,)."""
    return 1.0 / float((weights * weights).sum())


def systematic(weights: Array, uniform: float, count: int | None = None) -> Indices:
    """Indices (`count`,), N by default, of systematic resampling from `weights` (N,) with one `uniform` in [0, 1)."""
    count = len(weights) if count is None else count
    cumulated = weights.cumsum()
    positions = (np.arange(count) + uniform) / count * cumulated[-1]
    return np.minimum(cumulated.searchsorted(positions, side="right"), len(weights) - 1)
