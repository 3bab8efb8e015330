"""Sampled futures of the mixture Kalman filter, compiled, eight at a time.

A future is a draw from the mixture, discretised once, and then a recursion with process noise, volatility and switching
of its own. Its parameters, its sigma_y and the time constant of its gain stay as they were drawn.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from estimator.kernels.draws import ROWS, normal_quad, uniform_quad
from estimator.kernels.elementary import exponential
from estimator.kernels.lanes import JIT, LANES, choose_below, load, maximum, minimum, spread, square_root, store, within
from estimator.kernels.scratch import aligned, get, put
from estimator.mixture.kernels import gain_begins, gain_decay, gain_ends, gain_spread, moved_volatility, theta
from estimator.mixture.model import SMALLEST_PIVOT, WATTS
from estimator.mixture.modes import flow, modes, respond

_TINY = 1e-300


@njit(cache=True, **JIT)
def sample(shape, mean, covariance, normals, out):  # type: ignore[no-untyped-def]
    """`out` (n_z, K): draws from Gaussians, c and phi inside their bounds; packed covariances, standard `normals`
    (n_z, K)."""
    size, count = mean.shape
    bounded = shape.lower.shape[0]
    s = aligned(np.empty((covariance.shape[0] + 1) * LANES))
    for first in range(0, count, LANES):
        inside = within(first, count)
        for row in range(covariance.shape[0]):
            put(s, row, load(covariance, (row, first), inside))
        for j in range(size):
            below = j * (j + 1) // 2
            variance = get(s, below + j)
            pivot = variance
            for k in range(j):
                pivot = pivot - get(s, below + k) * get(s, below + k)
            inverse = choose_below(variance * SMALLEST_PIVOT, pivot, 1.0 / square_root(maximum(pivot, _TINY)), 0.0)
            put(s, below + j, pivot * inverse)
            for i in range(j + 1, size):
                value = get(s, i * (i + 1) // 2 + j)
                for k in range(j):
                    value = value - get(s, i * (i + 1) // 2 + k) * get(s, below + k)
                put(s, i * (i + 1) // 2 + j, value * inverse)
        for i in range(size):
            value = load(mean, (i, first), inside)
            for j in range(i + 1):
                value = value + get(s, i * (i + 1) // 2 + j) * load(normals, (j, first), inside)
            if i >= size - bounded:
                d = i - (size - bounded)
                value = minimum(maximum(value, shape.lower[d]), shape.upper[d])
            store(out, (i, first), inside, value)


@njit(cache=True, **JIT)
def _discretise(at, shape, settings, at_transition, at_input, at_gain, channels, s):  # type: ignore[no-untyped-def]
    """Rows A_d (n, n), B_d (n, n_u) and the response [K/kW] to a gain (n,) of a block, and row `response`."""
    n = shape.capacitance.shape[0]
    modes(at, shape.capacitance, shape.edges, settings.period, s)
    for i in range(n):
        for j in range(n):
            value = spread(0.0)
            for k in range(n):
                value = value + get(s, at.vectors + i * n + k) * get(s, at.decay + k) * get(s, at.vectors + j * n + k)
            scale = get(s, at.scale + j)
            put(s, at_transition + i * n + j, value / (scale * scale))
    unit = np.zeros(channels)
    for c in range(channels + 1):
        if c < channels:
            unit[:] = 0.0
            unit[c] = 1.0
            flow(at, n, shape.edges, shape.heat, shape.heat_gain, unit, s)
        else:
            for i in range(n):
                put(s, at.flow + i, WATTS if i == settings.gain_node else 0.0)
        for k in range(n):
            value = spread(0.0)
            for i in range(n):
                value = value + get(s, at.vectors + i * n + k) * get(s, at.flow + i)
            put(s, at.heat + k, value * settings.period * get(s, at.drive + k))
        for i in range(n):
            value = spread(0.0)
            for k in range(n):
                value = value + get(s, at.vectors + i * n + k) * get(s, at.heat + k)
            put(s, at_input + i * channels + c if c < channels else at_gain + i, value)
    for d in range(shape.heated.shape[0]):
        respond(at, n, shape.heated[d], settings.period, at.response + d * n, s)


@njit(cache=True, **JIT)
def paths(at, shape, settings, seed, origin, normal_stream, uniform_stream, plan, start, out):  # type: ignore[no-untyped-def]
    """`out` (h, n_y, K): temperatures of the measured nodes in sampled futures under `plan` (h, n_u + m)."""
    terms, heated = shape.term_place.shape[0], shape.heated.shape[0]
    n, channels = shape.capacitance.shape[0], plan.shape[1] - terms
    size, count = start.state.shape
    free, blocks, gains = shape.free.shape[0], start.log_alpha.shape[0], start.gain_on.shape[0]
    normals, uniforms = n + 2 * blocks + 2 * gains, blocks + 2 * gains
    at_transition = at.rows
    at_input = at_transition + n * n
    at_gain = at_input + n * channels
    at_normals = at_gain + n
    at_uniforms = at_normals + (normals + ROWS)
    at_alpha = at_uniforms + (uniforms + ROWS)
    at_known = at_alpha + blocks
    s = aligned(np.empty((at_known + heated + 1) * LANES))
    process_sd = np.sqrt(settings.process_variance)
    for first in range(0, count, LANES):
        inside = within(first, count)
        theta(at, shape, start.state[size - free :], first, inside, s)
        _discretise(at, shape, settings, at_transition, at_input, at_gain, channels, s)
        for i in range(n):
            put(s, at.mean + i, load(start.state, (i, first), inside))
        for b in range(blocks):
            put(s, at_alpha + b, load(start.log_alpha, (b, first), inside))
        gain, on, decay = spread(0.0), spread(0.0), spread(1.0)
        if gains:
            gain, on = load(start.state, (n, first), inside), load(start.gain_on, (0, first), inside)
            decay = gain_decay(load(start.log_hours, (0, first), inside), settings)
        for ahead in range(plan.shape[0]):
            step = origin + np.uint64(ahead + 1)
            for row in range(0, normals, ROWS):
                drawn = normal_quad(seed, step, normal_stream, row, first)
                for part in range(ROWS):
                    put(s, at_normals + row + part, drawn[part])
            for row in range(0, uniforms, ROWS):
                places = uniform_quad(seed, step, uniform_stream, row, first)
                for part in range(ROWS):
                    put(s, at_uniforms + row + part, places[part])
            for b in range(blocks):
                size_step, jump = get(s, at_normals + n + b), get(s, at_normals + n + blocks + b)
                value = moved_volatility(get(s, at_alpha + b), size_step, jump, get(s, at_uniforms + b), settings)
                put(s, at_alpha + b, value)
            if gains:
                place = get(s, at_uniforms + blocks)
                begins = gain_begins(on, place, settings.on_probability)
                ends = gain_ends(on, place, settings.off_probability)
                new = gain_spread(get(s, at_uniforms + blocks + 1), settings) * get(s, at_normals + n + 2 * blocks)
                gain, on = gain * (1.0 - begins - ends) + begins * new, on + begins - ends
            for d in range(heated):
                put(s, at_known + d, 0.0)
            for t in range(terms):
                row = at_known + shape.term_place[t]
                coefficient = load(start.state, (n + gains + t, first), inside)
                put(s, row, get(s, row) + plan[ahead, channels + t] * coefficient)
            for i in range(n):
                value = gain * get(s, at_gain + i)
                for j in range(n):
                    value = value + get(s, at_transition + i * n + j) * get(s, at.mean + j)
                for c in range(channels):
                    value = value + get(s, at_input + i * channels + c) * plan[ahead, c]
                for d in range(heated):
                    value = value + get(s, at.response + d * n + i) * get(s, at_known + d)
                noise = process_sd * get(s, at_normals + i)
                if settings.volatile_process:
                    noise = noise * exponential(get(s, at_alpha + shape.block[i]))
                put(s, at.later + i, value + noise)
            for i in range(n):
                put(s, at.mean + i, get(s, at.later + i))
            for y in range(shape.measured.shape[0]):
                store(out, (ahead, y, first), inside, get(s, at.mean + shape.measured[y]))
            if gains:
                walk = settings.gain_walk * get(s, at_normals + n + 2 * blocks + 1)
                if settings.volatile_gain:
                    walk = walk * exponential(get(s, at_alpha))
                gain = on * (decay * gain + walk)
