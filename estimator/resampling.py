"""Effective sample size and systematic resampling (Algorithm 1, line 14)."""

from __future__ import annotations

import numpy as np

from estimator.assembly import Indices
from estimator.types import Array


def effective_sample_size(weights: Array) -> float:
    """N_eff = 1 / sum w_i^2 of normalised `weights` (N,)."""
    return float(1.0 / np.sum(weights**2))


def systematic(weights: Array, uniform: float) -> Indices:
    """Indices (N,) of systematic resampling from `weights` (N,) with one `uniform` draw in [0, 1)."""
    count = len(weights)
    cumulated = np.cumsum(weights)
    positions = (np.arange(count) + uniform) / count * cumulated[-1]
    return np.minimum(np.searchsorted(cumulated, positions, side="right"), count - 1)
