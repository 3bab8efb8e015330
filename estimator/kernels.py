"""Numba kernels over all particles: measurement update, moments, rejuvenation, mixture quantiles.

Every sum over particles runs in a fixed order: the same inputs give the same bits. Nothing is compiled with fast-math,
which would break that and the handling of NaN. The Kalman prediction is in `kernel_propagate`.
"""

from __future__ import annotations

from math import erfc, exp, log, pi, sqrt

import numpy as np
from numba import njit

from estimator.types import Array

LANES = 64
"""Particles that are handled together, so that loops over them become vector instructions."""


@njit(cache=True, nogil=True, error_model="numpy")
def assimilate(node, y, variance, mean, covariance, out_mean, out_covariance, log_likelihood):  # type: ignore[no-untyped-def]
    """Kalman update of all particles with one scalar output of state `node` (Algorithm 1, line 12)."""
    n_x, particles = mean.shape
    gain = np.empty((n_x, LANES))
    column = np.empty((n_x, LANES))
    total = np.empty(LANES)
    innovation = np.empty(LANES)
    for first in range(0, particles, LANES):
        count = min(LANES, particles - first)
        for i in range(n_x):
            t = i * (i + 1) // 2 + node if i >= node else node * (node + 1) // 2 + i
            for w in range(count):
                column[i, w] = covariance[t, first + w]
        for w in range(count):
            total[w] = column[node, w] + variance
            innovation[w] = y - mean[node, first + w]
            log_likelihood[first + w] = -0.5 * (log(2 * pi * total[w]) + innovation[w] * innovation[w] / total[w])
        t = 0
        for i in range(n_x):
            for w in range(count):
                gain[i, w] = column[i, w] / total[w]
                out_mean[i, first + w] = mean[i, first + w] + gain[i, w] * innovation[w]
            for j in range(i + 1):
                for w in range(count):
                    out_covariance[t, first + w] = covariance[t, first + w] - gain[i, w] * column[j, w]
                t += 1


@njit(cache=True, nogil=True, error_model="numpy")
def weighted_moments(coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) and covariance (d, d) of coordinates (d, N) (24)-(25)."""
    size, particles = coordinates.shape
    mean = np.zeros(size)
    covariance = np.zeros((size, size))
    lane = np.empty(8)
    full = particles - particles % 8
    for i in range(size):
        lane[:] = 0.0
        for first in range(0, full, 8):
            for w in range(8):
                lane[w] += weights[first + w] * coordinates[i, first + w]
        for n in range(full, particles):
            lane[0] += weights[n] * coordinates[i, n]
        mean[i] = lane.sum()
    for i in range(size):
        for j in range(i + 1):
            lane[:] = 0.0
            for first in range(0, full, 8):
                for w in range(8):
                    n = first + w
                    lane[w] += weights[n] * (coordinates[i, n] - mean[i]) * (coordinates[j, n] - mean[j])
            for n in range(full, particles):
                lane[0] += weights[n] * (coordinates[i, n] - mean[i]) * (coordinates[j, n] - mean[j])
            covariance[i, j] = lane.sum()
            covariance[j, i] = covariance[i, j]
    return mean, covariance


@njit(cache=True, nogil=True, error_model="numpy")
def rejuvenate(shrink, mean, jitter, lower, upper, logit, coordinates, normals, out):  # type: ignore[no-untyped-def]
    """Gated Liu-West draw (28) for all particles; clipped to the box in log coordinates."""
    size, particles = coordinates.shape
    for first in range(0, particles, LANES):
        last = min(first + LANES, particles)
        for i in range(size):
            centre = (1.0 - shrink) * mean[i]
            for n in range(first, last):
                out[i, n] = shrink * coordinates[i, n] + centre
            for k in range(i + 1):
                factor = jitter[i, k]
                for n in range(first, last):
                    out[i, n] += factor * normals[k, n]
            if not logit:
                for n in range(first, last):
                    out[i, n] = min(max(out[i, n], lower[i]), upper[i])


@njit(cache=True, nogil=True, error_model="numpy")
def mean_log_parameters(lower, upper, logit, coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) of phi."""
    size, particles = coordinates.shape
    mean = np.zeros(size)
    for i in range(size):
        for n in range(particles):
            place = 1.0 / (1.0 + exp(-coordinates[i, n])) if logit else coordinates[i, n]
            mean[i] += weights[n] * place
        if logit:
            mean[i] = lower[i] + (upper[i] - lower[i]) * mean[i]
    return mean


@njit(cache=True, nogil=True, error_model="numpy")
def gather(rows, index, out):  # type: ignore[no-untyped-def]
    """Columns `index` of rows (m, N)."""
    for m in range(rows.shape[0]):
        for n in range(index.shape[0]):
            out[m, n] = rows[m, index[n]]


@njit(cache=True, nogil=True, error_model="numpy")
def mixture_quantile(level: float, weights: Array, means: Array, sds: Array) -> float:
    """The `level` quantile of a Gaussian mixture: Newton on its CDF, kept inside a shrinking bracket."""
    particles = weights.shape[0]
    total = 0.0
    centre = 0.0
    lower = np.inf
    upper = -np.inf
    for n in range(particles):
        if weights[n] > 0.0:
            total += weights[n]
            centre += weights[n] * means[n]
            lower = min(lower, means[n] - 9.0 * sds[n])
            upper = max(upper, means[n] + 9.0 * sds[n])
    centre /= total
    spread = 0.0
    for n in range(particles):
        spread += weights[n] * (sds[n] * sds[n] + (means[n] - centre) * (means[n] - centre))
    # A logistic start is close enough for any level; Newton does the rest.
    y = centre + sqrt(spread / total) * 0.5513 * log(level / (1.0 - level))
    for _ in range(200):
        if not lower < y < upper:
            y = 0.5 * (lower + upper)
        cdf = 0.0
        density = 0.0
        for n in range(particles):
            if weights[n] > 0.0:
                z = (y - means[n]) / sds[n]
                cdf += weights[n] * 0.5 * erfc(-z * 0.7071067811865476)
                density += weights[n] * exp(-0.5 * z * z) / sds[n]
        error = cdf / total - level
        if error > 0.0:
            upper = y
        else:
            lower = y
        slope = density / total * 0.3989422804014327
        step = error / slope if slope > 0.0 else np.inf
        if abs(step) <= 1e-13 * max(1.0, abs(y)) or upper - lower <= 1e-13 * max(1.0, abs(y)):
            return y - (step if abs(step) <= 1e-13 * max(1.0, abs(y)) else 0.0)
        y -= step
    return y
