"""The Kalman prediction of all particles, compiled: theta, network, exact zero-order hold, mean and covariance.

The topology comes in as index arrays: one cached compilation serves every network with the same number of states.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import overload

from estimator import unrolled
from estimator.unrolled import JIT, LANES, SMALL_NORM, layout
from estimator.vector_math import exponentials


def _rows(size: tuple[int, ...]) -> tuple[int, ...]:
    """`unrolled.layout` of as many states as `size` has entries, as compile-time constants."""
    return tuple(layout(len(size)))


@overload(_rows, jit_options=JIT)
def _rows_of(size):  # type: ignore[no-untyped-def]
    rows = tuple(layout(size.count))
    return lambda size: rows


@njit(cache=True, **JIT)
def parameters_of(coordinates, lower, upper, logit, free, fixed, first, count, theta, work, bits):  # type: ignore[no-untyped-def]
    """theta (n_theta * LANES) of particles first..first+count from their coordinates (d, N)."""
    dimensions = free.shape[0]
    for p in range(fixed.shape[0]):
        for w in range(LANES):
            theta[p * LANES + w] = fixed[p]
    for d in range(dimensions):
        row = coordinates[d, first : first + count]
        for w in range(count):
            work[d * LANES + w] = row[w]
        for w in range(count, LANES):
            work[d * LANES + w] = row[0]
    if logit:
        for t in range(dimensions * LANES):
            work[t] = -work[t]
        exponentials(work, bits, dimensions * LANES)
        for d in range(dimensions):
            low, width = lower[d], upper[d] - lower[d]
            for w in range(LANES):
                work[d * LANES + w] = low + width / (1.0 + work[d * LANES + w])
    exponentials(work, bits, dimensions * LANES)
    for d in range(dimensions):
        p = free[d]
        for w in range(LANES):
            theta[p * LANES + w] = work[d * LANES + w]


@njit(cache=True, **JIT)
def assemble_block(size, capacitance, edges, heat, heat_gain, theta, inputs, s):  # type: ignore[no-untyped-def]
    """Rows `conductance`, `flow` and the capacitances in `root` of a block (3)."""
    n_x = capacitance.shape[0]
    rows = _rows(size)
    conductance, flow, root = rows[0], rows[1], rows[2]
    for t in range(conductance * LANES, root * LANES):
        s[t] = 0.0
    for i in range(n_x):
        source, target = capacitance[i] * LANES, (root + i) * LANES
        for w in range(LANES):
            s[target + w] = theta[source + w]
    for e in range(edges.shape[0]):
        i, j, source = edges[e, 0], edges[e, 1], edges[e, 2] * LANES
        diagonal = (conductance + i * (i + 1) // 2 + i) * LANES
        for w in range(LANES):
            s[diagonal + w] += theta[source + w]
        if j < n_x:
            other = (conductance + j * (j + 1) // 2 + j) * LANES
            cross = (conductance + j * (j + 1) // 2 + i) * LANES
            for w in range(LANES):
                s[other + w] += theta[source + w]
            for w in range(LANES):
                s[cross + w] -= theta[source + w]
        else:
            temperature, target = inputs[j - n_x], (flow + i) * LANES
            for w in range(LANES):
                s[target + w] += theta[source + w] * temperature
    for e in range(heat.shape[0]):
        value, constant, sign = inputs[heat[e, 1]], heat_gain[e, 0], heat_gain[e, 1]
        target, source = (flow + heat[e, 0]) * LANES, heat[e, 2] * LANES
        for w in range(LANES):
            s[target + w] += (constant + sign * theta[source + w]) * value


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nnan", "nsz"})
def largest(s, first):  # type: ignore[no-untyped-def]
    """The largest of a row of finite numbers."""
    result = s[first]
    for w in range(LANES):
        result = max(result, s[first + w])
    return result


@njit(cache=True, **JIT)
def propagate(  # type: ignore[no-untyped-def]
    size, capacitance, edges, heat, heat_gain,
    lower, upper, logit, free, fixed,
    period, inputs, coordinates, mean, covariance, volatility, block, process_variance, out_mean, out_covariance,
):  # fmt: skip
    """Kalman prediction of all particles (Algorithm 1, line 9).

    `size` is a tuple of n_x entries. mean (n_x, N), covariance packed (n_tri, N); `volatility` (B, N) holds alpha^2 and
    `block` (n_x,) each node's row of it, so that Q_k is alpha^2 times `process_variance`.
    """
    n_x, particles = mean.shape
    n_tri = covariance.shape[0]
    rows = _rows(size)
    s = np.zeros(rows[10] * LANES)
    theta = np.zeros(fixed.shape[0] * LANES)
    work = np.zeros(max(free.shape[0], 1) * LANES)
    bits = np.zeros(work.shape[0], np.int64)
    decay, norm, at_mean, at_covariance, at_noise = rows[5], rows[6], rows[7], rows[8], rows[9]
    for first in range(0, particles, LANES):
        count = min(LANES, particles - first)
        parameters_of(coordinates, lower, upper, logit, free, fixed, first, count, theta, work, bits)
        assemble_block(size, capacitance, edges, heat, heat_gain, theta, inputs, s)
        unrolled.steady_state(size, s)
        unrolled.scale(size, s)
        scaling = -period
        squarings = 0
        while largest(s, norm * LANES) * -scaling > SMALL_NORM:
            scaling *= 0.5
            squarings += 1
        for t in range(decay * LANES, norm * LANES):
            s[t] *= scaling
        unrolled.exponential(size, s)
        for _ in range(squarings):
            unrolled.square(size, s)
        for i in range(n_x):
            for w in range(count):
                s[(at_mean + i) * LANES + w] = mean[i, first + w]
            for w in range(count):
                s[(at_noise + i) * LANES + w] = process_variance * volatility[block[i], first + w]
        for t in range(n_tri):
            for w in range(count):
                s[(at_covariance + t) * LANES + w] = covariance[t, first + w]
        unrolled.propagate(size, s)
        for i in range(n_x):
            for w in range(count):
                out_mean[i, first + w] = s[(at_mean + i) * LANES + w]
        for t in range(n_tri):
            for w in range(count):
                out_covariance[t, first + w] = s[(at_covariance + t) * LANES + w]
