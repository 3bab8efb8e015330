"""Scores of one forecast against what came, and mixtures made small enough to be scored."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from estimator.arrays import Array
from estimator.types import Mixture

COMPONENTS = 64
"""Components of a mixture that are scored: more change a score by less than its own noise."""

_SQRT_PI = math.sqrt(math.pi)
_SQRT_2 = math.sqrt(2.0)


def reduced(mixture: Mixture, count: int = COMPONENTS) -> Mixture:
    """At most `count` equally likely components of `mixture`, taken at even steps of its cumulated weights."""
    if len(mixture.weights) <= count:
        return mixture
    # Components in the order of their means, so that even steps see the whole of the distribution.
    order = np.argsort(mixture.means[0], kind="stable")
    cumulated = np.cumsum(mixture.weights[order])
    places = (np.arange(count) + 0.5) / count * cumulated[-1]
    chosen = order[np.minimum(np.searchsorted(cumulated, places), len(order) - 1)]
    return Mixture(np.full(count, 1.0 / count), mixture.means[:, chosen], mixture.sds[:, chosen])


def crps(mixture: Mixture, output: int, value: float) -> float:
    """Continuous ranked probability score [K] of one output's distribution against `value` [degC].

    Exact for the mixture of at most COMPONENTS Gaussians that stands for it (Grimit et al. 2006, equation 5).
    """
    small = reduced(mixture)
    return float(_mixture_crps(small.weights / small.weights.sum(), small.means[output], small.sds[output], value))


def gaussian_crps(mean: Array, sd: Array, value: float) -> Array:
    """Continuous ranked probability scores [K] of Gaussians with `mean` and `sd` (n,) against `value`."""
    z = (value - mean) / sd
    density = np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)
    scores: Array = sd * (z * np.vectorize(math.erf, otypes=[float])(z / _SQRT_2) + 2.0 * density - 1.0 / _SQRT_PI)
    return scores


@njit(cache=True)
def _expected_distance(mean, sd):  # type: ignore[no-untyped-def]
    """E|X| of X ~ N(mean, sd^2)."""
    z = mean / sd
    return mean * math.erf(z / _SQRT_2) + 2.0 * sd * math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


@njit(cache=True)
def _mixture_crps(weights, means, sds, value):  # type: ignore[no-untyped-def]
    near, apart = 0.0, 0.0
    for i in range(len(weights)):
        near += weights[i] * _expected_distance(value - means[i], sds[i])
        apart += weights[i] * weights[i] * _expected_distance(0.0, _SQRT_2 * sds[i])
        for j in range(i):
            sd = math.sqrt(sds[i] ** 2 + sds[j] ** 2)
            apart += 2.0 * weights[i] * weights[j] * _expected_distance(means[i] - means[j], sd)
    return near - 0.5 * apart
