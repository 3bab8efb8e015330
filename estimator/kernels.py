"""Numba kernels over all particles: measurement update, moments, rejuvenation, resampling.

Particles are handled in blocks. Sums run in an order that is fixed when they are compiled: the same inputs give the
same bits. The Kalman prediction is in `kernel_propagate`, the mixture quantiles in `vector_math`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from estimator import unrolled
from estimator.unrolled import JIT, LANES
from estimator.vector_math import BLOCK, SUMMING, exponentials, logarithms


@njit(cache=True, **JIT)
def assimilate(node, y, variance, mean, covariance, out_mean, out_covariance, log_likelihood):  # type: ignore[no-untyped-def]
    """Kalman update of all particles with one scalar output of state `node` (Algorithm 1, line 12)."""
    n_x, particles = mean.shape
    column, gain = np.empty((n_x, BLOCK)), np.empty((n_x, BLOCK))
    total, innovation = np.empty(BLOCK), np.empty(BLOCK)
    density, bits = np.empty(BLOCK), np.empty(BLOCK, np.int64)
    for first in range(0, particles, BLOCK):
        count = min(BLOCK, particles - first)
        for i in range(n_x):
            t = i * (i + 1) // 2 + node if i >= node else node * (node + 1) // 2 + i
            for w in range(count):
                column[i, w] = covariance[t, first + w]
        for w in range(count):
            total[w] = 1.0 / (column[node, w] + variance)
            innovation[w] = y - mean[node, first + w]
            density[w] = total[w] * 0.15915494309189535
        logarithms(density, bits, count)
        for w in range(count):
            log_likelihood[first + w] = 0.5 * (density[w] - innovation[w] * innovation[w] * total[w])
        t = 0
        for i in range(n_x):
            for w in range(count):
                gain[i, w] = column[i, w] * total[w]
                out_mean[i, first + w] = mean[i, first + w] + gain[i, w] * innovation[w]
            for j in range(i + 1):
                for w in range(count):
                    out_covariance[t, first + w] = covariance[t, first + w] - gain[i, w] * column[j, w]
                t += 1


@njit(cache=True, **SUMMING)
def _dot(left, right, count):  # type: ignore[no-untyped-def]
    total = 0.0
    for w in range(count):
        total += left[w] * right[w]
    return total


@njit(cache=True, **JIT)
def weighted_moments(coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) and covariance (d, d) of coordinates (d, N) (24)-(25)."""
    size, particles = coordinates.shape
    mean = np.zeros(size)
    covariance = np.zeros((size, size))
    centred, weighted = np.empty((size, BLOCK)), np.empty((size, BLOCK))
    for i in range(size):
        mean[i] = _dot(coordinates[i], weights, particles)
    for first in range(0, particles, BLOCK):
        count = min(BLOCK, particles - first)
        for i in range(size):
            for w in range(count):
                centred[i, w] = coordinates[i, first + w] - mean[i]
            for w in range(count):
                weighted[i, w] = centred[i, w] * weights[first + w]
            for j in range(i + 1):
                covariance[i, j] += _dot(weighted[i], centred[j], count)
    for i in range(size):
        for j in range(i):
            covariance[j, i] = covariance[i, j]
    return mean, covariance


@njit(cache=True, **JIT)
def rejuvenate(size, shrink, mean, jitter, lower, upper, logit, coordinates, normals, out):  # type: ignore[no-untyped-def]
    """Gated Liu-West draw (28) for all particles, clipped to the box in log coordinates; `size` has d entries."""
    dimensions, particles = coordinates.shape
    s = np.zeros(2 * dimensions * LANES)
    centre = (1.0 - shrink) * mean
    for first in range(0, particles, LANES):
        count = min(LANES, particles - first)
        for i in range(dimensions):
            for w in range(count):
                s[i * LANES + w] = coordinates[i, first + w]
            for w in range(count):
                s[(dimensions + i) * LANES + w] = normals[i, first + w]
        unrolled.rejuvenate(size, s, shrink, centre, jitter)
        for i in range(dimensions):
            if logit:
                for w in range(count):
                    out[i, first + w] = s[i * LANES + w]
            else:
                for w in range(count):
                    out[i, first + w] = min(max(s[i * LANES + w], lower[i]), upper[i])


@njit(cache=True, **SUMMING)
def mean_log_parameters(lower, upper, logit, coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) of phi."""
    size, particles = coordinates.shape
    mean = np.zeros(size)
    place, bits = np.empty(BLOCK), np.empty(BLOCK, np.int64)
    for i in range(size):
        total = 0.0
        for first in range(0, particles, BLOCK):
            count = min(BLOCK, particles - first)
            for w in range(count):
                place[w] = -coordinates[i, first + w]
            if logit:
                exponentials(place, bits, count)
                for w in range(count):
                    total += weights[first + w] / (1.0 + place[w])
            else:
                for w in range(count):
                    total -= weights[first + w] * place[w]
        mean[i] = lower[i] + (upper[i] - lower[i]) * total if logit else total
    return mean


@njit(cache=True, **JIT)
def systematic(weights, uniform, index):  # type: ignore[no-untyped-def]
    """Indices of systematic resampling from `weights` (N,) with one `uniform` draw in [0, 1) (line 14)."""
    particles = weights.shape[0]
    total = 0.0
    for n in range(particles):
        total += weights[n]
    cumulated = weights[0]
    source = 0
    for n in range(particles):
        position = (n + uniform) / particles * total
        while cumulated <= position and source < particles - 1:
            source += 1
            cumulated += weights[source]
        index[n] = source


@njit(cache=True, **JIT)
def weighted_quantiles(values, weights, levels, bins):  # type: ignore[no-untyped-def]
    """Smallest of `values` (N,) at which the cumulated `weights` (N,) reach each of `levels` (L,) of their sum.

    Only the few values of the bin that a level falls into are sorted; `bins` is the number of bins.
    """
    particles = values.shape[0]
    low, high, total = values[0], values[0], 0.0
    for n in range(particles):
        low, high = min(low, values[n]), max(high, values[n])
        total += weights[n]
    stretch = bins / (high - low) if high > low else 0.0
    mass = np.zeros(bins + 1)
    for n in range(particles):
        mass[int((values[n] - low) * stretch)] += weights[n]
    quantiles = np.empty(levels.shape[0])
    for q in range(levels.shape[0]):
        target, below, chosen = levels[q] * total, 0.0, 0
        while chosen < bins and below + mass[chosen] < target:
            below += mass[chosen]
            chosen += 1
        members = np.empty(particles, np.int64)
        count = 0
        for n in range(particles):
            if int((values[n] - low) * stretch) == chosen:
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


@njit(cache=True, **JIT)
def gather(rows, index, out):  # type: ignore[no-untyped-def]
    """Columns `index` of rows (m, N)."""
    for m in range(rows.shape[0]):
        for n in range(index.shape[0]):
            out[m, n] = rows[m, index[n]]
