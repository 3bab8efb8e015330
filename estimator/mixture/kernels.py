"""The moves of the mixture Kalman filter over all particles, compiled, eight particles at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array, Indices
from estimator.kernels.elementary import exponential, logarithm
from estimator.kernels.lanes import (
    JIT,
    LANES,
    choose_below,
    largest,
    load,
    maximum,
    minimum,
    spread,
    square_root,
    store,
    within,
)
from estimator.kernels.scratch import aligned, get, put
from estimator.mixture.model import HOUR, WATTS
from estimator.mixture.modes import flow, linearise, modes, transform

_INVERSE_TWO_PI = 0.15915494309189535
_TINY = 1e-300


class Shape(NamedTuple):
    """A network and its free parameters as arrays; rows as in `estimator.assembly.Topology`."""

    capacitance: Indices
    edges: Indices
    heat: Indices
    heat_gain: Array
    measured: Indices
    slot: Indices
    """(n_theta,): place among the free parameters, -1 for a fixed one."""
    free: Indices
    fixed: Array
    lower: Array
    upper: Array
    """(m + d,): bounds of c and phi."""
    prior_variance: Array
    """(m + d,): variances that they have a priori."""
    heated: Indices
    term_place: Indices
    coefficient_walk: Array
    """As in `MixtureModel`."""
    block: Indices


class Settings(NamedTuple):
    """Numbers of the model; kinds of noise as 1.0 or 0.0."""

    period: float
    gain_node: int
    """-1 without a gain."""
    process_variance: float
    volatile_process: float
    volatile_gain: float
    volatility_sd: float
    jump_probability: float
    jump_sd: float
    alpha_low: float
    alpha_high: float
    noise_walk: float
    noise_low: float
    noise_high: float
    on_probability: float
    proposed_on_probability: float
    off_probability: float
    spread_low: float
    spread_high: float
    decays: float
    hour_walk: float
    hour_low: float
    hour_high: float
    gain_walk: float
    parameter_variance: float


@njit(cache=True, **JIT)
def moved_volatility(value, step, jump, place, settings):  # type: ignore[no-untyped-def]
    """log alpha one step on: a normal step, rarely a jump, clipped."""
    value = value + settings.volatility_sd * step
    value = choose_below(place, settings.jump_probability, value + settings.jump_sd * jump, value)
    return minimum(maximum(value, settings.alpha_low), settings.alpha_high)


@njit(cache=True, **JIT)
def gain_begins(on, place, chance):  # type: ignore[no-untyped-def]
    """1 where a gain that is off begins, which it does with probability `chance`, else 0."""
    return choose_below(on, 0.5, choose_below(place, chance, 1.0, 0.0), 0.0)


@njit(cache=True, **JIT)
def gain_ends(on, place, chance):  # type: ignore[no-untyped-def]
    """1 where a gain that is on ends, which it does with probability `chance`, else 0."""
    return choose_below(0.5, on, choose_below(place, chance, 1.0, 0.0), 0.0)


@njit(cache=True, **JIT)
def gain_spread(place, settings):  # type: ignore[no-untyped-def]
    """Standard deviation [kW] of a new gain."""
    return exponential(settings.spread_low + (settings.spread_high - settings.spread_low) * place)


@njit(cache=True, **JIT)
def gain_decay(log_hours, settings):  # type: ignore[no-untyped-def]
    """What is left of a gain after a step."""
    if settings.decays == 0.0:
        return spread(1.0)
    return exponential(-settings.period / HOUR * exponential(-1.0 * log_hours))


@njit(cache=True, **JIT)
def theta(at, shape, phi, first, inside, s):  # type: ignore[no-untyped-def]
    """Row `theta` from the rows phi (d, N)."""
    for p in range(shape.fixed.shape[0]):
        put(s, at.theta + p, shape.fixed[p])
    for d in range(shape.free.shape[0]):
        put(s, at.theta + shape.free[d], exponential(load(phi, (d, first), inside)))


@njit(cache=True, **JIT)
def _switch(at, n, size, on, place, size_place, settings, s):  # type: ignore[no-untyped-def]
    """Whether the gain is on next; its row of mean and covariance where that changed."""
    begins = gain_begins(on, place, settings.proposed_on_probability)
    ends = gain_ends(on, place, settings.off_probability)
    kept = 1.0 - begins - ends
    new = begins * gain_spread(size_place, settings)
    put(s, at.mean + n, get(s, at.mean + n) * kept)
    for j in range(size):
        row = at.covariance + (n * (n + 1) // 2 + j if j <= n else j * (j + 1) // 2 + n)
        put(s, row, get(s, row) * kept)
    variance = at.covariance + n * (n + 1) // 2 + n
    put(s, variance, get(s, variance) + new * new)
    return on + begins - ends


@njit(cache=True, **JIT)
def _predict_covariance(at, n, gains, size, decay, gain_variance, walk, parameter_variance, first, inside, out, s):  # type: ignore[no-untyped-def]
    """`out` = F P F^T + Q of the particles first..first+7, without the noise of x."""
    for i in range(n):
        for j in range(size):
            # Along row j of the packed triangle up to the diagonal, then down its column.
            value, row = spread(0.0), at.covariance + j * (j + 1) // 2
            for k in range(j + 1):
                value = value + get(s, at.jacobian + i * size + k) * get(s, row + k)
            row += j
            for k in range(j + 1, size):
                row += k
                value = value + get(s, at.jacobian + i * size + k) * get(s, row)
            put(s, at.product + i * size + j, value)
    t = 0
    for i in range(n):
        for j in range(i + 1):
            value = spread(0.0)
            for k in range(size):
                value = value + get(s, at.product + i * size + k) * get(s, at.jacobian + j * size + k)
            store(out, (t, first), inside, value)
            t += 1
    for i in range(n, size):
        for j in range(i + 1):
            value = get(s, at.product + j * size + i) if j < n else get(s, at.covariance + t)
            if n <= i < n + gains:
                value = value * decay
            if n <= j < n + gains:
                value = value * decay
            if i == j:
                if i < n + gains:
                    value = value + gain_variance
                elif i < n + gains + walk.shape[0]:
                    value = value + walk[i - n - gains]
                else:
                    value = value + parameter_variance
            store(out, (t, first), inside, value)
            t += 1


@njit(cache=True, **JIT)
def _bound_covariance(shape, size, first, inside, out):  # type: ignore[no-untyped-def]
    """No coefficient or log parameter varies more than under its prior."""
    bounded = shape.lower.shape[0]
    for d in range(bounded):
        i = size - bounded + d
        variance = load(out, (i * (i + 1) // 2 + i, first), inside)
        scale = square_root(minimum(shape.prior_variance[d] / maximum(variance, _TINY), 1.0))
        for j in range(size):
            row = i * (i + 1) // 2 + j if j <= i else j * (j + 1) // 2 + i
            factor = scale * scale if j == i else scale
            store(out, (row, first), inside, load(out, (row, first), inside) * factor)


@njit(cache=True, **JIT)
def propagate(at, shape, settings, gate, inputs, normals, uniforms, old, new, worth):  # type: ignore[no-untyped-def]
    """All particles one period on under `inputs` (n_u + m,), from `old` into `new` (`Particles`).

    `worth` (N,) becomes the log of the probability of each particle's gain over that of its proposal.
    """
    n, blocks, outputs = shape.capacitance.shape[0], old.log_alpha.shape[0], old.log_noise.shape[0]
    gains, terms = old.gain_on.shape[0], shape.term_place.shape[0]
    size, particles = old.mean.shape
    free = shape.free.shape[0]
    known = inputs.shape[0] - terms
    parameter_variance = gate * gate * settings.parameter_variance
    log_begins = np.log(settings.on_probability / settings.proposed_on_probability)
    log_stays = np.log((1.0 - settings.on_probability) / (1.0 - settings.proposed_on_probability))
    worth[:] = 0.0
    s = aligned(np.empty((at.rows + 1) * LANES))
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        for b in range(blocks):
            value = load(old.log_alpha, (b, first), inside)
            step, jump = load(normals, (b, first), inside), load(normals, (blocks + b, first), inside)
            value = moved_volatility(value, step, jump, load(uniforms, (b, first), inside), settings)
            store(new.log_alpha, (b, first), inside, value)
        for y in range(outputs):
            value = load(old.log_noise, (y, first), inside)
            value = value + settings.noise_walk * load(normals, (2 * blocks + y, first), inside)
            store(new.log_noise, (y, first), inside, minimum(maximum(value, settings.noise_low), settings.noise_high))
        for row in range(size):
            put(s, at.mean + row, load(old.mean, (row, first), inside))
        for row in range(old.covariance.shape[0]):
            put(s, at.covariance + row, load(old.covariance, (row, first), inside))
        theta(at, shape, old.mean[size - free :], first, inside, s)
        flow(at, n, shape.edges, shape.heat, shape.heat_gain, inputs, s)
        decay, gain_variance = spread(1.0), spread(0.0)
        if gains:
            hours = load(old.log_hours, (0, first), inside)
            hours = hours + settings.hour_walk * load(normals, (2 * blocks + outputs, first), inside)
            hours = minimum(maximum(hours, settings.hour_low), settings.hour_high)
            store(new.log_hours, (0, first), inside, hours)
            place, size_place = load(uniforms, (blocks, first), inside), load(uniforms, (blocks + 1, first), inside)
            before = load(old.gain_on, (0, first), inside)
            on = _switch(at, n, size, before, place, size_place, settings, s)
            store(new.gain_on, (0, first), inside, on)
            ratio = choose_below(on, 0.5, log_stays, log_begins)
            store(worth, (first,), inside, choose_below(before, 0.5, ratio, 0.0))
            decay = gain_decay(hours, settings)
            walk = spread(settings.gain_walk)
            if settings.volatile_gain:
                walk = walk * exponential(load(new.log_alpha, (0, first), inside))
            gain_variance = on * walk * walk
            gain = get(s, at.mean + n)
            put(s, at.flow + settings.gain_node, get(s, at.flow + settings.gain_node) + WATTS * gain)
            store(new.mean, (n, first), inside, decay * gain)
        for t in range(terms):
            row = at.flow + shape.heated[shape.term_place[t]]
            put(s, row, get(s, row) + inputs[known + t] * get(s, at.mean + n + gains + t))
        modes(at, shape.capacitance, shape.edges, settings.period, s)
        transform(at, n, settings.period, s)
        linearise(at, shape, settings.period, inputs, settings.gain_node, size, s)
        for i in range(n):
            store(new.mean, (i, first), inside, get(s, at.later + i))
        for i in range(n + gains, size):
            store(new.mean, (i, first), inside, get(s, at.mean + i))
        _predict_covariance(
            at, n, gains, size, decay, gain_variance, shape.coefficient_walk, parameter_variance,
            first, inside, new.covariance, s,
        )  # fmt: skip
        for i in range(n):
            variance = spread(settings.process_variance)
            if settings.volatile_process:
                alpha = exponential(load(new.log_alpha, (shape.block[i], first), inside))
                variance = variance * alpha * alpha
            row = i * (i + 1) // 2 + i
            store(new.covariance, (row, first), inside, load(new.covariance, (row, first), inside) + variance)
        if settings.parameter_variance > 0.0 or terms > 0:
            _bound_covariance(shape, size, first, inside, new.covariance)


@njit(cache=True, **JIT)
def assimilate(shape, outputs, old, mean, covariance, log_likelihood):  # type: ignore[no-untyped-def]
    """Kalman update of all particles by every output (n_y,) that is not NaN, c and phi kept in their bounds."""
    size, particles = old.mean.shape
    packed = old.covariance.shape[0]
    s = aligned(np.empty((packed + 2 * size + 1) * LANES))
    at_mean, at_column = packed, packed + size
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        for row in range(size):
            put(s, at_mean + row, load(old.mean, (row, first), inside))
        for row in range(packed):
            put(s, row, load(old.covariance, (row, first), inside))
        whole = spread(0.0)
        for y in range(outputs.shape[0]):
            if outputs[y] == outputs[y]:
                node = shape.measured[y]
                for i in range(size):
                    row = i * (i + 1) // 2 + node if i >= node else node * (node + 1) // 2 + i
                    put(s, at_column + i, get(s, row))
                noise = exponential(2.0 * load(old.log_noise, (y, first), inside))
                precision = 1.0 / (get(s, at_column + node) + noise)
                innovation = outputs[y] - get(s, at_mean + node)
                whole = whole + 0.5 * (logarithm(precision * _INVERSE_TWO_PI) - innovation * innovation * precision)
                t = 0
                for i in range(size):
                    gain = get(s, at_column + i) * precision
                    put(s, at_mean + i, get(s, at_mean + i) + gain * innovation)
                    for j in range(i + 1):
                        put(s, t, get(s, t) - gain * get(s, at_column + j))
                        t += 1
                # P - P P / (P + R) is P R / (P + R), which keeps its digits where P is far above R.
                for i in range(size):
                    row = i * (i + 1) // 2 + node if i >= node else node * (node + 1) // 2 + i
                    put(s, row, get(s, at_column + i) * (noise * precision))
        store(log_likelihood, (first,), inside, whole)
        _confine(shape, size, at_mean, s)
        for row in range(size):
            store(mean, (row, first), inside, get(s, at_mean + row))
        for row in range(packed):
            store(covariance, (row, first), inside, get(s, row))


@njit(cache=True, **JIT)
def _confine(shape, size, at_mean, s):  # type: ignore[no-untyped-def]
    """What of c and phi left its bounds on its bound, the rest where it is most probable given that, then cut off."""
    bounded = shape.lower.shape[0]
    for d in range(bounded):
        i = size - bounded + d
        value = get(s, at_mean + i)
        excess = minimum(maximum(value, shape.lower[d]), shape.upper[d]) - value
        if largest(excess * excess) > 0.0:
            variance = get(s, i * (i + 1) // 2 + i)
            scale = choose_below(0.0, variance, excess / maximum(variance, _TINY), 0.0)
            for j in range(size):
                row = i * (i + 1) // 2 + j if j <= i else j * (j + 1) // 2 + i
                put(s, at_mean + j, get(s, at_mean + j) + get(s, row) * scale)
    for d in range(bounded):
        row = at_mean + size - bounded + d
        put(s, row, minimum(maximum(get(s, row), shape.lower[d]), shape.upper[d]))
