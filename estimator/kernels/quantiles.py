"""Quantiles of Gaussian mixtures over particles, and of weighted particles, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from estimator.kernels.elementary import bell_of, tail_of
from estimator.kernels.lanes import (
    JIT,
    LANES,
    as_value,
    choose_below,
    lanes,
    largest,
    load,
    maximum,
    spread,
    store,
    total,
    within,
)

_TOLERANCE = 1e-11
"""The error [K] that a quantile may keep."""
_REACH = 9.0
"""Standard deviations beyond which a normal distribution has no mass that counts."""
_ROOT_TWO_PI = 0.3989422804014327


@intrinsic
def _bell_and_tail(typingctx, z):  # type: ignore[no-untyped-def]
    """exp(-z^2 / 2) and Q(z)."""

    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        at = as_value(context, builder, sig.args[0], values[0])
        bell = bell_of(at)
        return context.make_tuple(builder, sig.return_type, [bell.value, tail_of(at, bell).value])

    return types.UniTuple(lanes, 2)(z), codegen


@njit(cache=True, **JIT)
def mixture_cdf(y, weights, means, precisions):  # type: ignore[no-untyped-def]
    """1 - CDF at `y`, density and its derivative of a Gaussian mixture; weights, means and precisions (1 / sd) (N,)."""
    particles = weights.shape[0]
    mass, above, density, slope = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        weight, precision = load(weights, (first,), inside), load(precisions, (first,), inside)
        z = (y - load(means, (first,), inside)) * precision
        bell, tail = _bell_and_tail(z)
        mass, above = mass + weight, above + weight * tail
        height = weight * bell * precision
        density, slope = density + height, slope - height * z * precision
    whole = total(mass)
    return total(above) / whole, total(density) / whole * _ROOT_TWO_PI, total(slope) / whole * _ROOT_TWO_PI


@njit(cache=True, **JIT)
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
        # Far from the root the correction may be anything; held to a factor of two it cannot stall the search.
        step = newton / min(max(1.0 - 0.5 * newton * slope / density, 0.5), 2.0) if density > 0.0 else np.inf
        # What a step leaves is at most step^3 |f'^2 / 4 f^2 - f'' / 6 f|, where f' / f is below 9 over the smallest sd.
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
    particles = weights.shape[0]
    precisions = np.empty(particles)
    mass, first_moment, second_moment = spread(0.0), spread(0.0), spread(0.0)
    highest, lowest, sharpest = spread(-np.inf), spread(-np.inf), spread(0.0)
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        weight, mean, sd = load(weights, (first,), inside), load(means, (first,), inside), load(sds, (first,), inside)
        precision = 1.0 / sd
        store(precisions, (first,), inside, precision)
        centred = mean - means[0]
        mass, first_moment = mass + weight, first_moment + weight * centred
        second_moment = second_moment + weight * (centred * centred + sd * sd)
        highest = maximum(choose_below(0.0, weight, mean + _REACH * sd, -np.inf), highest)
        lowest = maximum(choose_below(0.0, weight, _REACH * sd - mean, -np.inf), lowest)
        sharpest = maximum(choose_below(0.0, weight, precision, 0.0), sharpest)
    whole = total(mass)
    centre = total(first_moment) / whole
    spread_of = np.sqrt(max(total(second_moment) / whole - centre * centre, 0.0))
    lower, upper, narrowest = -largest(lowest), largest(highest), 1.0 / largest(sharpest)
    quantiles = np.empty(levels.shape[0])
    for q in range(levels.shape[0]):
        y = means[0] + centre + spread_of * deviates[q]
        quantiles[q] = _search(levels[q], y, lower, upper, narrowest, weights, means, precisions)
    return quantiles


@njit(cache=True, **JIT)
def weighted_quantiles(values, weights, levels, bins):  # type: ignore[no-untyped-def]
    """Smallest of `values` (N,) at which the cumulated `weights` (N,) reach each of `levels` (L,) of their sum.

    Only the few values of the bin that a level falls into are sorted; `bins` is the number of bins.
    """
    particles = values.shape[0]
    low, high, whole = values[0], values[0], 0.0
    for n in range(particles):
        low, high = min(low, values[n]), max(high, values[n])
        whole += weights[n]
    stretch = bins / (high - low) if high > low else 0.0
    mass = np.zeros(bins + 1)
    place_of = np.empty(particles, np.int32)
    for n in range(particles):
        place_of[n] = int((values[n] - low) * stretch)
    for n in range(particles):
        mass[place_of[n]] += weights[n]
    quantiles = np.empty(levels.shape[0])
    for q in range(levels.shape[0]):
        target, below, chosen = levels[q] * whole, 0.0, 0
        while chosen < bins and below + mass[chosen] < target:
            below += mass[chosen]
            chosen += 1
        members = np.empty(particles, np.int64)
        count = 0
        for n in range(particles):
            if place_of[n] == chosen:
                members[count] = n
                count += 1
        order = np.argsort(values[members[:count]], kind="mergesort")
        place = 0
        below += weights[members[order[0]]]
        while below < target and place < count - 1:
            place += 1
            below += weights[members[order[place]]]
        quantiles[q] = values[members[order[place]]]
    return quantiles
