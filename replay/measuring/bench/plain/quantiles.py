"""Quantiles of Gaussian mixtures over particles in plain Numba: `estimator.kernels.quantiles` without lanes."""

from __future__ import annotations

import numpy as np
from numba import njit

from estimator.kernels.lanes import JIT
from estimator.kernels.quantiles import _REACH, _ROOT_TWO_PI, _TOLERANCE
from replay.measuring.bench.plain.elementary import exponential, tail
from replay.measuring.bench.plain.kernels import WIDTH, total


@njit(**JIT)
def mixture_cdf(y, weights, means, precisions):  # type: ignore[no-untyped-def]
    """1 - CDF at `y`, density and its derivative of a Gaussian mixture; weights, means and precisions (1 / sd) (N,)."""
    mass, above, density, slope = np.zeros(WIDTH), np.zeros(WIDTH), np.zeros(WIDTH), np.zeros(WIDTH)
    for first in range(0, weights.shape[0], WIDTH):
        weight, mean = weights[first : first + WIDTH], means[first : first + WIDTH]
        precision = precisions[first : first + WIDTH]
        for w in range(weight.shape[0]):
            z = (y - mean[w]) * precision[w]
            bell = exponential(z * z * -0.5)
            height = weight[w] * bell * precision[w]
            mass[w] += weight[w]
            above[w] += weight[w] * tail(z, bell)
            density[w] += height
            slope[w] -= height * z * precision[w]
    whole = total(mass)
    return total(above) / whole, total(density) / whole * _ROOT_TWO_PI, total(slope) / whole * _ROOT_TWO_PI


@njit(**JIT)
def _search(level, start, lower, upper, narrowest, weights, means, precisions):  # type: ignore[no-untyped-def]
    """Halley's method from `start`, kept in a shrinking bracket."""
    y = start
    for _ in range(200):
        if not lower < y < upper:
            y = 0.5 * (lower + upper)
        above, density, slope = mixture_cdf(y, weights, means, precisions)
        error = (1.0 - level) - above
        if error > 0.0:
            upper = y
        else:
            lower = y
        newton = error / density if density > 0.0 else np.inf
        step = newton / min(max(1.0 - 0.5 * newton * slope / density, 0.5), 2.0) if density > 0.0 else np.inf
        if 34.0 * abs(step) ** 3 <= _TOLERANCE * narrowest * narrowest:
            return y - step
        if upper - lower <= _TOLERANCE:
            return y
        y -= step
    return y


@njit(cache=True, **JIT)
def mixture_quantiles(levels, deviates, weights, means, sds):  # type: ignore[no-untyped-def]
    """Quantiles (L,) of a Gaussian mixture at `levels` (L,), whose standard normal quantiles are `deviates` (L,).

    weights (N,), means and sds (N,) in degC and K.
    """
    particles, origin = weights.shape[0], means[0]
    precisions = np.empty(particles)
    mass, first_moment, second_moment = np.zeros(WIDTH), np.zeros(WIDTH), np.zeros(WIDTH)
    highest, lowest, sharpest = np.full(WIDTH, -np.inf), np.full(WIDTH, np.inf), np.zeros(WIDTH)
    for first in range(0, particles, WIDTH):
        weight, mean, sd = weights[first : first + WIDTH], means[first : first + WIDTH], sds[first : first + WIDTH]
        precision = precisions[first : first + WIDTH]
        for w in range(weight.shape[0]):
            precision[w] = 1.0 / sd[w]
            centred = mean[w] - origin
            mass[w] += weight[w]
            first_moment[w] += weight[w] * centred
            second_moment[w] += weight[w] * (centred * centred + sd[w] * sd[w])
        for w in range(weight.shape[0]):
            used = weight[w] > 0.0
            upper = mean[w] + _REACH * sd[w] if used else -np.inf
            lower = mean[w] - _REACH * sd[w] if used else np.inf
            sharp = precision[w] if used else 0.0
            highest[w] = upper if upper > highest[w] else highest[w]
            lowest[w] = lower if lower < lowest[w] else lowest[w]
            sharpest[w] = sharp if sharp > sharpest[w] else sharpest[w]
    whole = total(mass)
    centre = total(first_moment) / whole
    spread_of = np.sqrt(max(total(second_moment) / whole - centre * centre, 0.0))
    quantiles = np.empty(levels.shape[0])
    for q in range(levels.shape[0]):
        y = origin + centre + spread_of * deviates[q]
        quantiles[q] = _search(
            levels[q], y, lowest.min(), highest.max(), 1.0 / sharpest.max(), weights, means, precisions
        )
    return quantiles
