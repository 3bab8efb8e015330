"""The moves of the mixture Kalman filter over all particles, compiled, one particle after the other."""

from __future__ import annotations

from math import exp, log, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array, Indices
from estimator.kernels.jit import INLINE, JIT
from estimator.kernels.modes import bend, heat_flow, memory, modes, move, respond, slopes, transition
from estimator.kernels.packing import packed
from estimator.mixture.model import HOUR, WATTS

_TWO_PI = 6.283185307179586
_TINY = 1e-300

place_of = njit(**INLINE)(packed)


class Shape(NamedTuple):
    """What is free in a network, and its terms; as in `MixtureModel`."""

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
    block: Indices


class Settings(NamedTuple):
    """Numbers of the model."""

    period: float
    gain_node: int
    """-1 without a gain."""
    process_variance: float
    volatile_process: bool
    volatile_gain: bool
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
    decays: bool
    hour_walk: float
    hour_low: float
    hour_high: float
    gain_walk: float
    parameter_variance: float


@njit(**INLINE)
def copied(source, target):  # type: ignore[no-untyped-def]
    """`target` becomes `source`, element by element: slices take Numba far longer to compile."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@njit(**INLINE)
def clipped(value, low, high):  # type: ignore[no-untyped-def]
    """`value` inside its bounds."""
    return min(max(value, low), high)


@njit(**INLINE)
def moved_volatility(value, step, jump, place, settings):  # type: ignore[no-untyped-def]
    """log alpha one step on: a normal step, rarely a jump, clipped."""
    value += settings.volatility_sd * step
    if place < settings.jump_probability:
        value += settings.jump_sd * jump
    return clipped(value, settings.alpha_low, settings.alpha_high)


@njit(**INLINE)
def gain_spread(place, settings):  # type: ignore[no-untyped-def]
    """Standard deviation [kW] of a new gain."""
    return exp(settings.spread_low + (settings.spread_high - settings.spread_low) * place)


@njit(**INLINE)
def gain_decay(log_hours, settings):  # type: ignore[no-untyped-def]
    """What is left of a gain after a step."""
    return exp(-settings.period / HOUR * exp(-log_hours)) if settings.decays else 1.0


@njit(**INLINE)
def gain_walk(log_alpha, settings):  # type: ignore[no-untyped-def]
    """Standard deviation of the random walk of a gain that is on [kW]; `log_alpha` (B,)."""
    return settings.gain_walk * exp(log_alpha[0]) if settings.volatile_gain else settings.gain_walk


@njit(**INLINE)
def set_parameters(shape, phi, theta):  # type: ignore[no-untyped-def]
    """The free entries of theta from phi (d,)."""
    for d in range(shape.free.shape[0]):
        theta[shape.free[d]] = exp(phi[d])


@njit(**INLINE)
def _unpack(packed_rows, full):  # type: ignore[no-untyped-def]
    t = 0
    for i in range(full.shape[0]):
        for j in range(i + 1):
            full[i, j] = full[j, i] = packed_rows[t]
            t += 1


@njit(**INLINE)
def _switch(q, place, size_place, settings, on, mean, covariance):  # type: ignore[no-untyped-def]
    """Whether the gain, component `q`, is on next; its row of mean and covariance where that changed."""
    if on < 0.5 and place < settings.proposed_on_probability:
        later, variance = 1.0, gain_spread(size_place, settings) ** 2
    elif on > 0.5 and place < settings.off_probability:
        later, variance = 0.0, 0.0
    else:
        return on
    mean[q] = 0.0
    for i in range(mean.shape[0]):
        covariance[q, i] = covariance[i, q] = 0.0
    covariance[q, q] = variance
    return later


@njit(**INLINE)
def _linearise(topology, shape, settings, theta, inputs, mean, first, at, bent, turned, response, jacobian):  # type: ignore[no-untyped-def]
    """`jacobian` (n, n_z) of the temperatures by z, after `modes` and `move`; `first` is the place of phi in z."""
    n, size = jacobian.shape
    terms = shape.term_place.shape[0]
    bend(at, bent)
    slopes(topology, shape.slot, theta, settings.period, inputs, mean, bent, at, turned)
    transition(at, jacobian)
    if settings.gain_node >= 0:
        respond(at, settings.gain_node, WATTS * settings.period, jacobian[:, n])
    for d in range(shape.heated.shape[0]):
        respond(at, shape.heated[d], settings.period, response[d])
    for t in range(terms):
        for i in range(n):
            jacobian[i, first - terms + t] = inputs[inputs.shape[0] - terms + t] * response[shape.term_place[t], i]
    for i in range(n):
        for d in range(size - first):
            value = 0.0
            for k in range(n):
                value += at.shape[k, i] * turned[d, k]
            jacobian[i, first + d] = value


@njit(**INLINE)
def _predict_covariance(covariance, jacobian, decay, gains, product, out):  # type: ignore[no-untyped-def]
    """`out` (n_z, n_z) = F P F^T, where F is `jacobian` (n, n_z), then `decay` of the gain, then 1."""
    n, size = jacobian.shape
    for i in range(n):
        for j in range(size):
            product[i, j] = 0.0
        for k in range(size):
            for j in range(size):
                product[i, j] += jacobian[i, k] * covariance[k, j]
    for i in range(n):
        for j in range(i + 1):
            value = 0.0
            for k in range(size):
                value += product[i, k] * jacobian[j, k]
            out[i, j] = value
    for i in range(n, size):
        kept = decay if i < n + gains else 1.0
        for j in range(n):
            out[i, j] = kept * product[j, i]
        for j in range(n, i + 1):
            out[i, j] = kept * (decay if j < n + gains else 1.0) * covariance[i, j]


@njit(**INLINE)
def _add_noise(shape, settings, gains, gate, log_alpha, gain_variance, out):  # type: ignore[no-untyped-def]
    """Process noise of x, q, c and phi on the diagonal of `out`."""
    n, size = shape.block.shape[0], out.shape[0]
    for i in range(n):
        alpha = exp(log_alpha[shape.block[i]]) if settings.volatile_process else 1.0
        out[i, i] += settings.process_variance * alpha * alpha
    if gains:
        out[n, n] += gain_variance
    first = n + gains + shape.coefficient_walk.shape[0]
    for i in range(n + gains, first):
        out[i, i] += shape.coefficient_walk[i - n - gains]
    for i in range(first, size):
        out[i, i] += gate * gate * settings.parameter_variance


@njit(**INLINE)
def _bound_covariance(shape, out):  # type: ignore[no-untyped-def]
    """No coefficient or log parameter varies more than under its prior; of `out` the lower triangle."""
    size, bounded = out.shape[0], shape.lower.shape[0]
    for d in range(bounded):
        i = size - bounded + d
        if out[i, i] > shape.prior_variance[d]:
            scale = sqrt(shape.prior_variance[d] / out[i, i])
            for j in range(i + 1):
                out[i, j] *= scale
            for j in range(i, size):
                out[j, i] *= scale


@njit(**JIT)
def propagate(topology, shape, settings, gate, inputs, normals, uniforms, old, new, worth):  # type: ignore[no-untyped-def]
    """All particles one period on under `inputs` (n_u + m,), from `old` into `new` (`Particles`).

    `worth` (N,) becomes the log of the probability of each particle's gain over that of its proposal.
    """
    n, blocks, outputs = topology.capacitance.shape[0], old.log_alpha.shape[0], old.log_noise.shape[0]
    gains, terms, free = old.gain_on.shape[0], shape.term_place.shape[0], shape.free.shape[0]
    size, particles = old.mean.shape
    known = inputs.shape[0] - terms
    log_begins = log(settings.on_probability / settings.proposed_on_probability)
    log_stays = log((1.0 - settings.on_probability) / (1.0 - settings.proposed_on_probability))
    at, theta, bent, turned = memory(n), shape.fixed.copy(), np.empty((n, n)), np.empty((free, n))
    response, jacobian, product = np.empty((shape.heated.shape[0], n)), np.empty((n, size)), np.empty((n, size))
    mean, covariance, later = np.empty(size), np.empty((size, size)), np.empty((size, size))
    for k in range(particles):
        for b in range(blocks):
            new.log_alpha[b, k] = moved_volatility(
                old.log_alpha[b, k], normals[b, k], normals[blocks + b, k], uniforms[b, k], settings
            )
        for y in range(outputs):
            value = old.log_noise[y, k] + settings.noise_walk * normals[2 * blocks + y, k]
            new.log_noise[y, k] = clipped(value, settings.noise_low, settings.noise_high)
        copied(old.mean[:, k], mean)
        _unpack(old.covariance[:, k], covariance)
        set_parameters(shape, mean[size - free :], theta)
        heat_flow(topology, theta, inputs, at)
        decay, gain_variance, worth[k] = 1.0, 0.0, 0.0
        if gains:
            hours = old.log_hours[0, k] + settings.hour_walk * normals[2 * blocks + outputs, k]
            new.log_hours[0, k] = clipped(hours, settings.hour_low, settings.hour_high)
            before = old.gain_on[0, k]
            on = _switch(n, uniforms[blocks, k], uniforms[blocks + 1, k], settings, before, mean, covariance)
            new.gain_on[0, k] = on
            if before < 0.5:
                worth[k] = log_begins if on > 0.5 else log_stays
            decay = gain_decay(new.log_hours[0, k], settings)
            gain_variance = on * gain_walk(new.log_alpha[:, k], settings) ** 2
            at.flow[settings.gain_node] += WATTS * mean[n]
        for t in range(terms):
            at.flow[shape.heated[shape.term_place[t]]] += inputs[known + t] * mean[n + gains + t]
        modes(topology, theta, settings.period, at)
        copied(mean, new.mean[:, k])
        if gains:
            new.mean[n, k] *= decay
        move(settings.period, mean, at, new.mean[:n, k])
        _linearise(topology, shape, settings, theta, inputs, mean, size - free, at, bent, turned, response, jacobian)
        # D in x' = D (...) depends on the capacitances too.
        for i in range(n):
            if shape.slot[topology.capacitance[i]] >= 0:
                jacobian[i, size - free + shape.slot[topology.capacitance[i]]] -= 0.5 * new.mean[i, k]
        _predict_covariance(covariance, jacobian, decay, gains, product, later)
        _add_noise(shape, settings, gains, gate, new.log_alpha[:, k], gain_variance, later)
        if settings.parameter_variance > 0.0 or terms > 0:
            _bound_covariance(shape, later)
        row = 0
        for i in range(size):
            for j in range(i + 1):
                new.covariance[row, k] = later[i, j]
                row += 1


@njit(**JIT)
def assimilate(measured, shape, outputs, old, mean, covariance, log_likelihood):  # type: ignore[no-untyped-def]
    """Kalman update of all particles by every output (n_y,) that is not NaN, c and phi kept in their bounds."""
    size, particles = old.mean.shape
    column, now, spread = np.empty(size), np.empty(size), np.empty(old.covariance.shape[0])
    for k in range(particles):
        copied(old.mean[:, k], now)
        copied(old.covariance[:, k], spread)
        whole = 0.0
        for y in range(outputs.shape[0]):
            if not np.isnan(outputs[y]):
                node, noise = measured[y], exp(2.0 * old.log_noise[y, k])
                for i in range(size):
                    column[i] = spread[place_of(i, node)]
                total = column[node] + noise
                innovation = outputs[y] - now[node]
                whole -= 0.5 * (log(_TWO_PI * total) + innovation * innovation / total)
                t = 0
                for i in range(size):
                    gain = column[i] / total
                    now[i] += gain * innovation
                    for j in range(i + 1):
                        spread[t] -= gain * column[j]
                        t += 1
                # P - P P / (P + R) is P R / (P + R), which keeps its digits where P is far above R.
                for i in range(size):
                    spread[place_of(i, node)] = column[i] * (noise / total)
        log_likelihood[k] = whole
        _confine(shape, now, spread)
        copied(now, mean[:, k])
        copied(spread, covariance[:, k])


@njit(**INLINE)
def _confine(shape, mean, covariance):  # type: ignore[no-untyped-def]
    """What of c and phi left its bounds on its bound, the rest where it is most probable given that, then cut off."""
    size, bounded = mean.shape[0], shape.lower.shape[0]
    for d in range(bounded):
        i = size - bounded + d
        excess, variance = clipped(mean[i], shape.lower[d], shape.upper[d]) - mean[i], covariance[place_of(i, i)]
        if excess != 0.0 and variance > 0.0:
            for j in range(size):
                mean[j] += covariance[place_of(i, j)] * excess / max(variance, _TINY)
    for d in range(bounded):
        i = size - bounded + d
        mean[i] = clipped(mean[i], shape.lower[d], shape.upper[d])
