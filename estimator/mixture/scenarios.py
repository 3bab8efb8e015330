"""Sampled futures of the mixture Kalman filter, compiled, one after the other.

A future is a draw from the mixture, discretised once, and then a recursion with process noise, volatility and switching
of its own. Its parameters, its sigma_y and the time constant of its gain stay as they were drawn.
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np
from numba import njit

from estimator.kernels.draws import fill
from estimator.kernels.jit import JIT
from estimator.kernels.modes import heat_flow, memory, modes, move
from estimator.mixture.kernels import (
    clipped,
    copied,
    gain_decay,
    gain_spread,
    gain_walk,
    moved_volatility,
    place_of,
    set_parameters,
)
from estimator.mixture.model import SMALLEST_PIVOT, WATTS


@njit(**JIT)
def sample(shape, mean, covariance, normals, out):  # type: ignore[no-untyped-def]
    """`out` (n_z, K): draws from Gaussians, c and phi inside their bounds; packed covariances, standard `normals`
    (n_z, K)."""
    size, count = mean.shape
    first, factor = size - shape.lower.shape[0], np.empty(covariance.shape[0])
    for k in range(count):
        copied(covariance[:, k], factor)
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
        for i in range(size):
            value = mean[i, k]
            for j in range(i + 1):
                value += factor[place_of(i, j)] * normals[j, k]
            out[i, k] = clipped(value, shape.lower[i - first], shape.upper[i - first]) if i >= first else value


@njit(**JIT)
def paths(topology, shape, settings, seed, origin, normal_stream, uniform_stream, plan, start, out):  # type: ignore[no-untyped-def]
    """`out` (h, n_y, K): temperatures of the measured nodes in sampled futures under `plan` (h, n_u + m)."""
    n, terms, free = topology.capacitance.shape[0], shape.term_place.shape[0], shape.free.shape[0]
    channels, (size, count) = plan.shape[1] - terms, start.state.shape
    blocks, gains = start.log_alpha.shape[0], start.gain_on.shape[0]
    normals, uniforms = np.empty(n + 2 * blocks + 2 * gains), np.empty(blocks + 2 * gains)
    at, theta, log_alpha = memory(n), shape.fixed.copy(), np.empty(blocks)
    now, later = np.empty(n), np.empty(n)
    process_sd = sqrt(settings.process_variance)
    for k in range(count):
        set_parameters(shape, start.state[size - free :, k], theta)
        modes(topology, theta, settings.period, at)
        copied(start.state[:, k], now)
        copied(start.log_alpha[:, k], log_alpha)
        gain, on, decay = 0.0, 0.0, 1.0
        if gains:
            gain, on, decay = start.state[n, k], start.gain_on[0, k], gain_decay(start.log_hours[0, k], settings)
        for ahead in range(plan.shape[0]):
            step = origin + np.uint64(ahead + 1)
            fill(seed, step, normal_stream, True, k, normals)
            fill(seed, step, uniform_stream, False, k, uniforms)
            for b in range(blocks):
                log_alpha[b] = moved_volatility(
                    log_alpha[b], normals[n + b], normals[n + blocks + b], uniforms[b], settings
                )
            heat_flow(topology, theta, plan[ahead], at)
            if gains:
                if on < 0.5 and uniforms[blocks] < settings.on_probability:
                    on, gain = 1.0, gain_spread(uniforms[blocks + 1], settings) * normals[n + 2 * blocks]
                elif on > 0.5 and uniforms[blocks] < settings.off_probability:
                    on, gain = 0.0, 0.0
                at.flow[settings.gain_node] += WATTS * gain
            for t in range(terms):
                heat = plan[ahead, channels + t] * start.state[n + gains + t, k]
                at.flow[shape.heated[shape.term_place[t]]] += heat
            move(settings.period, now, at, later)
            for i in range(n):
                alpha = exp(log_alpha[shape.block[i]]) if settings.volatile_process else 1.0
                now[i] = later[i] + process_sd * alpha * normals[i]
            for y in range(topology.measured.shape[0]):
                out[ahead, y, k] = now[topology.measured[y]]
            if gains:
                gain = on * (decay * gain + gain_walk(log_alpha, settings) * normals[n + 2 * blocks + 1])
