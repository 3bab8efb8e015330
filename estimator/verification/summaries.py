"""What is told of the mixtures of a forecast: moments and quantiles, time by time."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import ndtri

from estimator.arrays import Array
from estimator.kernels.quantiles import mixture_quantiles
from estimator.types import Mixtures

_MEANS, _SDS = 24, 4
"""How finely components are told apart by their means and by their standard deviations."""

_REACH = 4.0
"""Standard deviations of the means within which they are told apart."""


class Summary(NamedTuple):
    """Of the outputs at L successive times, in degC and K."""

    means: Array
    """(L, n_y)."""
    sds: Array
    """(L, n_y)."""
    quantiles: Array
    """(L, n_y, Q)."""


def summary(mixtures: Mixtures, levels: Array, exact: bool) -> Summary:
    """Moments of `mixtures`, and their quantiles at `levels` (Q,): of all components if `exact`, otherwise of
    _MEANS x _SDS that stand for them."""
    times, outputs, _ = mixtures.means.shape
    told = Summary(np.empty((times, outputs)), np.empty((times, outputs)), np.empty((times, outputs, len(levels))))
    _summarise(levels, ndtri(levels), *map(np.ascontiguousarray, mixtures), exact, *told)
    return told


def as_distributed(paths: Array, mixtures: Mixtures) -> Array:
    """`paths` (K, L, n_y) with the distributions of `mixtures`, time by time: the lowest path of a time becomes its
    lowest quantile, and so on, so that every path keeps its place among the others (ensemble copula coupling, Schefzik
    et al. 2013)."""
    count = len(paths)
    levels = (np.arange(count) + 0.5) / count
    places = np.argsort(np.argsort(paths, axis=0, kind="stable"), axis=0)
    values = summary(mixtures, levels, exact=False).quantiles
    return np.take_along_axis(values.transpose(2, 0, 1), places, axis=0)


@njit(cache=True, nogil=True)
def _summarise(levels, deviates, weights, means, sds, exact, out_means, out_sds, out_quantiles):  # type: ignore[no-untyped-def]
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
                out_quantiles[t, y] = out_means[t, y] + out_sds[t, y] * deviates
            elif exact or size <= _MEANS * _SDS:
                out_quantiles[t, y] = mixture_quantiles(levels, deviates, weights[t], means[t, y], sds[t, y])
            else:
                few = _condensed(weights[t], means[t, y], sds[t, y], centre)
                out_quantiles[t, y] = mixture_quantiles(levels, deviates, *few)


@njit(cache=True, nogil=True)
def _condensed(weights, means, sds, centre):  # type: ignore[no-untyped-def]
    """At most _MEANS x _SDS Gaussians with the moments of those that they stand for, which are alike in mean and in
    standard deviation: the tails of a mixture are made by its wide components, whose means may be like the others'."""
    away, narrowest, widest = 0.0, np.inf, 0.0
    for n in range(len(weights)):
        away += weights[n] * (means[n] - centre) ** 2
        if weights[n] > 0.0:
            narrowest, widest = min(narrowest, sds[n]), max(widest, sds[n])
    whole = weights.sum()
    reach = _REACH * math.sqrt(away / whole)
    across = _MEANS / (2.0 * reach) if reach > 0.0 else 0.0
    along = _SDS / math.log(widest / narrowest) if widest > narrowest else 0.0
    shares, firsts, seconds = np.zeros(_MEANS * _SDS), np.zeros(_MEANS * _SDS), np.zeros(_MEANS * _SDS)
    for n in range(len(weights)):
        if weights[n] > 0.0:
            row = int(min(max((means[n] - centre + reach) * across, 0.0), _MEANS - 1.0))
            place = row * _SDS + int(min(math.log(sds[n] / narrowest) * along, _SDS - 1.0))
            shares[place] += weights[n]
            firsts[place] += weights[n] * (means[n] - centre)
            seconds[place] += weights[n] * ((means[n] - centre) ** 2 + sds[n] ** 2)
    # A share too small to divide by would leave nothing but rounding.
    chosen = np.flatnonzero(shares > 1e-12 * whole)
    kept = shares[chosen]
    first, second = firsts[chosen] / kept, seconds[chosen] / kept
    return kept, centre + first, np.sqrt(np.maximum(second - first * first, 1e-18))
