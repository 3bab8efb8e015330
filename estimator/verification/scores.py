"""Scores of one forecast against what came, and mixtures made small enough to be scored."""

import math

import numpy as np
from numba import njit
from scipy.special import ndtr

from estimator.arrays import Array
from estimator.types import Mixture

COMPONENTS = 32
"""Components of a mixture that are scored: more change a score by less than its own noise."""

_REACH = 3.0
"""Standard deviations of the component means within which `reduced` tells them apart."""
_ROOT_2 = math.sqrt(2.0)
_ROOT_PI = math.sqrt(math.pi)
_ROOT_2_PI = math.sqrt(2.0 * math.pi)


def reduced(mixture: Mixture, count: int = COMPONENTS) -> Mixture:
    """At most `count` Gaussians that stand for `mixture`, with the same mean and variance of every output.

    Components whose mean of the first output falls into the same of `count` equal intervals become one with their
    moments (West 1993). A mixture that is small enough is returned as it is.
    """
    if len(mixture.weights) <= count:
        return mixture
    return Mixture(*merged(*mixture, count))


def crps(mixture: Mixture, output: int, value: float) -> float:
    """Continuous ranked probability score [K] of one output's distribution against `value` [degC].

    Exact for the mixture of at most COMPONENTS Gaussians that stands for it (Grimit et al. 2006, equation 5).
    """
    rows = slice(output, output + 1)
    small = reduced(Mixture(mixture.weights, mixture.means[rows], mixture.sds[rows]))
    return float(_crps(small.weights / small.weights.sum(), small.means[0], small.sds[0], value))


def gaussian_crps(mean: Array, sd: Array, value: float) -> Array:
    """Continuous ranked probability scores [K] of Gaussians with `mean` and `sd` (n,) against `value`."""
    z = (value - mean) / sd
    return sd * (z * (2.0 * ndtr(z) - 1.0) + 2.0 * np.exp(-0.5 * z**2) / _ROOT_2_PI - 1.0 / _ROOT_PI)


def distribution(mixture: Mixture, output: int, value: float) -> float:
    """Probability that one output is below `value` [degC]."""
    return float(_distribution(mixture.weights, mixture.means[output], mixture.sds[output], value))


@njit(cache=True, nogil=True)
def merged(weights, means, sds, count):  # type: ignore[no-untyped-def]
    outputs, size = means.shape
    whole, centre, spread = 0.0, 0.0, 0.0
    for n in range(size):
        whole += weights[n]
        centre += weights[n] * (means[0, n] - means[0, 0])
    centre = means[0, 0] + centre / whole
    for n in range(size):
        spread += weights[n] * (means[0, n] - centre) ** 2
    reach = _REACH * math.sqrt(spread / whole)
    stretch = count / (2.0 * reach) if reach > 0.0 else 0.0
    shares, firsts, seconds = np.zeros(count), np.zeros((outputs, count)), np.zeros((outputs, count))
    for n in range(size):
        place = (means[0, n] - centre + reach) * stretch
        bin = int(min(max(place, 0.0), count - 1.0))
        shares[bin] += weights[n]
        for y in range(outputs):
            away = means[y, n] - means[y, 0]
            firsts[y, bin] += weights[n] * away
            seconds[y, bin] += weights[n] * (away * away + sds[y, n] * sds[y, n])
    # A share too small to divide by would leave nothing but rounding.
    chosen = np.flatnonzero(shares > 1e-12 * whole)
    small_means, small_sds = np.empty((outputs, len(chosen))), np.empty((outputs, len(chosen)))
    for k in range(len(chosen)):
        share = shares[chosen[k]]
        for y in range(outputs):
            first = firsts[y, chosen[k]] / share
            small_means[y, k] = means[y, 0] + first
            small_sds[y, k] = math.sqrt(max(seconds[y, chosen[k]] / share - first * first, 1e-18))
    kept = shares[chosen]
    return kept / kept.sum(), small_means, small_sds


@njit(cache=True, nogil=True)
def expected_distance(mean, sd):  # type: ignore[no-untyped-def]
    """E|X| of X ~ N(mean, sd^2)."""
    z = mean / sd
    return mean * math.erf(z / _ROOT_2) + 2.0 * sd * math.exp(-0.5 * z * z) / _ROOT_2_PI


@njit(cache=True, nogil=True)
def _crps(weights, means, sds, value):  # type: ignore[no-untyped-def]
    near, apart = 0.0, 0.0
    for i in range(len(weights)):
        near += weights[i] * expected_distance(value - means[i], sds[i])
        apart += weights[i] * weights[i] * expected_distance(0.0, _ROOT_2 * sds[i])
        for j in range(i):
            sd = math.sqrt(sds[i] * sds[i] + sds[j] * sds[j])
            apart += 2.0 * weights[i] * weights[j] * expected_distance(means[i] - means[j], sd)
    return near - 0.5 * apart


@njit(cache=True, nogil=True)
def _distribution(weights, means, sds, value):  # type: ignore[no-untyped-def]
    below, whole = 0.0, 0.0
    for i in range(len(weights)):
        below += weights[i] * 0.5 * math.erfc((means[i] - value) / (sds[i] * _ROOT_2))
        whole += weights[i]
    return below / whole
