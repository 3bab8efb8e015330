"""What is told of the mixtures of a forecast: moments and quantiles, time by time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import ndtri

from estimator.arrays import Array
from estimator.kernels.quantiles import mixture_quantiles
from estimator.types import Mixtures
from estimator.verification.scores import merged


class Summary(NamedTuple):
    """Of the outputs at L successive times, in degC and K."""

    means: Array
    """(L, n_y)."""
    sds: Array
    """(L, n_y)."""
    quantiles: Array
    """(L, n_y, Q)."""


def summary(mixtures: Mixtures, levels: Array, count: int) -> Summary:
    """Moments of `mixtures`, and their quantiles at `levels` (Q,) from at most `count` Gaussians (`reduced`)."""
    times, outputs, _ = mixtures.means.shape
    told = Summary(np.empty((times, outputs)), np.empty((times, outputs)), np.empty((times, outputs, len(levels))))
    _summarise(levels, ndtri(levels), *map(np.ascontiguousarray, mixtures), count, *told)
    return told


@njit(cache=True, nogil=True)
def _summarise(levels, deviates, weights, means, sds, count, out_means, out_sds, out_quantiles):  # type: ignore[no-untyped-def]
    times, outputs, size = means.shape
    for t in range(times):
        whole = weights[t].sum()
        for y in range(outputs):
            centre, spread = 0.0, 0.0
            for n in range(size):
                centre += weights[t, n] * means[t, y, n]
            centre /= whole
            for n in range(size):
                spread += weights[t, n] * (sds[t, y, n] ** 2 + (means[t, y, n] - centre) ** 2)
            out_means[t, y], out_sds[t, y] = centre, math.sqrt(spread / whole)
        if size == 1:
            # Of a single Gaussian no root has to be found.
            for y in range(outputs):
                out_quantiles[t, y] = out_means[t, y] + out_sds[t, y] * deviates
        elif size <= count:
            for y in range(outputs):
                out_quantiles[t, y] = mixture_quantiles(levels, deviates, weights[t], means[t, y], sds[t, y])
        else:
            shares, centres, spreads = merged(weights[t], means[t], sds[t], count)
            for y in range(outputs):
                out_quantiles[t, y] = mixture_quantiles(levels, deviates, shares, centres[y], spreads[y])
