"""Sampled futures of the mixture Kalman filter, compiled, a block at a time.

A future is a draw from the mixture, discretised once, and then a recursion with process noise, volatility and switching
of its own. Its parameters, its sigma_y and the time constant of its gain stay as they were drawn.
"""

from math import sqrt

import numpy as np
from numba import njit

from estimator.kernels.blocks import fixed_parameters, load
from estimator.kernels.draws import fill, padded
from estimator.kernels.elementary import exponential
from estimator.kernels.jit import JIT, PART, WIDTH
from estimator.kernels.modes import heat_flow, memory, modes, move
from estimator.mixture.kernels import (
    clipped,
    gain_decays,
    gain_spread,
    gain_walks,
    moved_volatility,
    place_of,
    set_parameters,
)
from estimator.mixture.model import SMALLEST_PIVOT, WATTS


@njit(**PART)
def _factorise(packed, size, factor):  # type: ignore[no-untyped-def]
    """The lower triangular root of a positive semidefinite matrix, both packed, into `factor`."""
    for t in range(factor.shape[0]):
        factor[t] = packed[t]
    for j in range(size):
        variance = factor[place_of(j, j)]
        pivot = variance
        for m in range(j):
            pivot -= factor[place_of(j, m)] ** 2
        inverse = 1.0 / sqrt(pivot) if pivot > variance * SMALLEST_PIVOT else 0.0
        factor[place_of(j, j)] = pivot * inverse
        for i in range(j + 1, size):
            value = factor[place_of(i, j)]
            for m in range(j):
                value -= factor[place_of(i, m)] * factor[place_of(j, m)]
            factor[place_of(i, j)] = value * inverse


@njit(**JIT)
def sample(shape, mean, covariance, index, normals, out):  # type: ignore[no-untyped-def]
    """`out` (n_z, K): draws from the Gaussians `index` (K,) of `mean` (n_z, N) and packed `covariance`, c and phi in
    their bounds; `normals` (n_z, K) are standard."""
    size, count = mean.shape[0], index.shape[0]
    first, factor = size - shape.lower.shape[0], np.empty(covariance.shape[0])
    for k in range(count):
        # Successive draws mostly come from the same particle.
        if k == 0 or index[k] != index[k - 1]:
            _factorise(covariance[:, index[k]], size, factor)
        for i in range(size):
            value = mean[i, index[k]]
            for j in range(i + 1):
                value += factor[place_of(i, j)] * normals[j, k]
            out[i, k] = clipped(value, shape.lower[i - first], shape.upper[i - first]) if i >= first else value


@njit(**JIT)
def paths(size, topology, shape, settings, seed, origin, normal_stream, uniform_stream, plan, start, out):  # type: ignore[no-untyped-def]
    """`out` (h, n_y, K): temperatures of the measured nodes in sampled futures under `plan` (h, n_u + m).

    `size` is a tuple of n_x entries.
    """
    n, terms, free = len(size), shape.term_place.shape[0], shape.free.shape[0]
    channels, (whole, count) = plan.shape[1] - terms, start.state.shape
    blocks, gains = start.log_alpha.shape[0], start.gain_on.shape[0]
    normals = np.empty((padded(n + 2 * blocks + 2 * gains), WIDTH))
    uniforms = np.zeros((padded(blocks + 2 * gains), WIDTH))
    switches = blocks > 0 or settings.on_probability > 0.0 or settings.off_probability > 0.0
    at, theta, log_alpha = memory(size), np.empty((shape.fixed.shape[0], WIDTH)), np.empty((blocks, WIDTH))
    state, now, later = np.empty((whole, WIDTH)), np.empty((n, WIDTH)), np.empty((n, WIDTH))
    gain, on, hours = np.empty(WIDTH), np.empty((1, WIDTH)), np.empty((1, WIDTH))
    decay, walk = np.empty(WIDTH), np.empty(WIDTH)
    process_sd = sqrt(settings.process_variance)
    fixed_parameters(shape.fixed, theta)
    for first in range(0, count, WIDTH):
        width = min(WIDTH, count - first)
        load(start.state, first, width, state)
        load(start.log_alpha, first, width, log_alpha)
        set_parameters(shape, state[whole - free :], width, theta)
        modes(size, topology, theta, settings.period, width, at)
        load(start.state[:n], first, width, now)
        if gains:
            load(start.gain_on, first, width, on)
            load(start.log_hours, first, width, hours)
            gain_decays(hours[0], settings, width, decay)
            for w in range(width):
                gain[w] = state[n, w]
        for ahead in range(plan.shape[0]):
            step = origin + np.uint64(ahead + 1)
            fill(seed, step, normal_stream, True, first, width, normals)
            if switches:
                fill(seed, step, uniform_stream, False, first, width, uniforms)
            for b in range(blocks):
                for w in range(width):
                    log_alpha[b, w] = moved_volatility(
                        log_alpha[b, w], normals[n + b, w], normals[n + blocks + b, w], uniforms[b, w], settings
                    )
            heat_flow(topology, theta, plan[ahead], width, at)
            if gains:
                for w in range(width):
                    begins = on[0, w] < 0.5 and uniforms[blocks, w] < settings.on_probability
                    ends = on[0, w] > 0.5 and uniforms[blocks, w] < settings.off_probability
                    if begins:
                        gain[w] = gain_spread(uniforms[blocks + 1, w], settings) * normals[n + 2 * blocks, w]
                    on[0, w] = 1.0 if begins else (0.0 if ends else on[0, w])
                    gain[w] *= on[0, w]
                for w in range(width):
                    at.flow[settings.gain_node, w] += WATTS * gain[w]
            for t in range(terms):
                node, power = shape.heated[shape.term_place[t]], plan[ahead, channels + t]
                # Most habits are of another hour.
                if power != 0.0:
                    for w in range(width):
                        at.flow[node, w] += power * state[n + gains + t, w]
            move(size, settings.period, now, width, at, later)
            for i in range(n):
                if settings.volatile_process:
                    for w in range(width):
                        now[i, w] = later[i, w] + process_sd * exponential(log_alpha[shape.block[i], w]) * normals[i, w]
                else:
                    for w in range(width):
                        now[i, w] = later[i, w] + process_sd * normals[i, w]
            for y in range(topology.measured.shape[0]):
                for w in range(width):
                    out[ahead, y, first + w] = now[topology.measured[y], w]
            if gains:
                gain_walks(log_alpha, settings, width, walk)
                for w in range(width):
                    gain[w] = on[0, w] * (decay[w] * gain[w] + walk[w] * normals[n + 2 * blocks + 1, w])
