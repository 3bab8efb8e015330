"""Quantiles of Gaussian mixtures, compiled."""

from math import sqrt

import numpy as np
from numba import njit

from estimator.kernels.elementary import exponential, upper_tail
from estimator.kernels.jit import JIT, WIDTH

_TOLERANCE = 1e-11
"""The error [K] that a quantile may keep."""
_REACH = 9.0
"""Standard deviations beyond which a normal distribution has no mass that counts."""
_ROOT_TWO_PI = 0.3989422804014327


@njit(**JIT)
def mixture_cdf(y, weights, means, sds):  # type: ignore[no-untyped-def]
    """1 - CDF at `y`, density and its derivative of a Gaussian mixture, times its mass; weights, means and sds (N,)."""
    particles = weights.shape[0]
    above, density, slope = np.zeros(WIDTH), np.zeros(WIDTH), np.zeros(WIDTH)
    for first in range(0, particles, WIDTH):
        for w in range(min(WIDTH, particles - first)):
            weight, sharpness = weights[first + w], 1.0 / sds[first + w]
            z = (y - means[first + w]) * sharpness
            bell = exponential(-0.5 * z * z)
            height = weight * bell * sharpness
            above[w] += weight * upper_tail(z, bell)
            density[w] += height
            slope[w] -= height * z * sharpness
    return above.sum(), density.sum() * _ROOT_TWO_PI, slope.sum() * _ROOT_TWO_PI


@njit(**JIT)
def _search(beyond, start, lower, upper, narrowest, weights, means, sds):  # type: ignore[no-untyped-def]
    """Where the mass above is `beyond`: Halley's method from `start`, kept in a shrinking bracket."""
    y = start
    for _ in range(200):
        if not lower < y < upper:
            y = 0.5 * (lower + upper)
        above, density, slope = mixture_cdf(y, weights, means, sds)
        error = beyond - above
        if error > 0.0:
            upper = y
        else:
            lower = y
        newton = error / density if density > 0.0 else np.inf
        # Far from the root the correction may be anything; held to a factor of two it cannot stall the search.
        step = newton / min(max(1.0 - 0.5 * newton * slope / density, 0.5), 2.0) if density > 0.0 else np.inf
        # What a step leaves is at most step^3 |f'^2 / 4 f^2 - f'' / 6 f|, where f' / f is below 9 over the smallest sd.
        if 34.0 * abs(step) ** 3 <= _TOLERANCE * narrowest * narrowest:
            return y - step
        if upper - lower <= _TOLERANCE:
            return y
        y -= step
    return y


@njit(**JIT)
def mixture_quantiles(levels, deviates, weights, means, sds):  # type: ignore[no-untyped-def]
    """Quantiles (L,) of a Gaussian mixture at `levels` (L,), whose standard normal quantiles are `deviates` (L,).

    weights (N,), means and sds (N,) in degC and K.
    """
    mass, first_moment, second_moment = 0.0, 0.0, 0.0
    lower, upper, narrowest = np.inf, -np.inf, np.inf
    for n in range(weights.shape[0]):
        centred = means[n] - means[0]
        mass += weights[n]
        first_moment += weights[n] * centred
        second_moment += weights[n] * (centred * centred + sds[n] * sds[n])
        if weights[n] > 0.0:
            lower = min(lower, means[n] - _REACH * sds[n])
            upper = max(upper, means[n] + _REACH * sds[n])
            narrowest = min(narrowest, sds[n])
    centre = first_moment / mass
    spread = sqrt(max(second_moment / mass - centre * centre, 0.0))
    quantiles = np.empty(levels.shape[0])
    for q in range(levels.shape[0]):
        y = means[0] + centre + spread * deviates[q]
        quantiles[q] = _search((1.0 - levels[q]) * mass, y, lower, upper, narrowest, weights, means, sds)
    return quantiles
