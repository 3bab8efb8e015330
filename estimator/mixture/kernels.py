"""The moves of the mixture Kalman filter over all particles, compiled, a block at a time."""

from math import log, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import HOUR, Array, Indices
from estimator.kernels.blocks import fixed_parameters, load, store
from estimator.kernels.elementary import exponential, logarithm
from estimator.kernels.jit import INLINE, JIT, PART, WIDTH
from estimator.kernels.modes import bend, heat_flow, memory, modes, move, respond, slopes, transition
from estimator.kernels.packing import packed
from estimator.mixture.model import WATTS

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
def clipped(value, low, high):  # type: ignore[no-untyped-def]
    """`value` inside its bounds."""
    return min(max(value, low), high)


@njit(**INLINE)
def moved_volatility(value, step, jump, place, settings):  # type: ignore[no-untyped-def]
    """log alpha one step on: a normal step, rarely a jump, clipped."""
    value += settings.volatility_sd * step
    value = value + settings.jump_sd * jump if place < settings.jump_probability else value
    return clipped(value, settings.alpha_low, settings.alpha_high)


@njit(**INLINE)
def gain_spread(place, settings):  # type: ignore[no-untyped-def]
    """Standard deviation [kW] of a new gain."""
    return exponential(settings.spread_low + (settings.spread_high - settings.spread_low) * place)


@njit(**PART)
def gain_decays(log_hours, settings, width, out):  # type: ignore[no-untyped-def]
    """`out`: what is left of a gain after a step; all (WIDTH,)."""
    for w in range(width):
        out[w] = exponential(-settings.period / HOUR * exponential(-log_hours[w])) if settings.decays else 1.0


@njit(**PART)
def gain_walks(log_alpha, settings, width, out):  # type: ignore[no-untyped-def]
    """`out` (WIDTH,): standard deviation of the random walk of a gain that is on [kW]; `log_alpha` (B, WIDTH)."""
    for w in range(width):
        out[w] = settings.gain_walk
    if settings.volatile_gain:
        for w in range(width):
            out[w] *= exponential(log_alpha[0, w])


@njit(**PART)
def set_parameters(shape, phi, width, theta):  # type: ignore[no-untyped-def]
    """The free entries of theta from phi (d, WIDTH)."""
    for d in range(shape.free.shape[0]):
        entry = shape.free[d]
        for w in range(width):
            theta[entry, w] = exponential(phi[d, w])


@njit(**PART)
def _switch(q, places, sizes, settings, before, on, width, mean, covariance):  # type: ignore[no-untyped-def]
    """`on` (WIDTH,): whether the gain, component `q`, is on next; its row of mean and covariance where that changed."""
    for w in range(width):
        begins = before[w] < 0.5 and places[w] < settings.proposed_on_probability
        ends = before[w] > 0.5 and places[w] < settings.off_probability
        on[w] = 1.0 if begins else (0.0 if ends else before[w])
        if begins or ends:
            mean[q, w] = 0.0
            for i in range(mean.shape[0]):
                covariance[place_of(q, i), w] = 0.0
            if begins:
                covariance[place_of(q, q), w] = gain_spread(sizes[w], settings) ** 2


@njit(**INLINE)
def _linearise(  # type: ignore[no-untyped-def]
    size, topology, shape, settings, theta, inputs, mean, later, first, width, at, bent, turned, response, jacobian
):
    """`jacobian` (n, n_z, WIDTH) of the temperatures `later` by z, after `modes` and `move`; phi begins at `first`."""
    n, terms = len(size), shape.term_place.shape[0]
    bend(size, width, at, bent)
    slopes(size, topology, shape.slot, theta, settings.period, inputs, mean, bent, width, at, turned)
    transition(size, width, at, jacobian)
    if settings.gain_node >= 0:
        respond(size, settings.gain_node, WATTS * settings.period, width, at, jacobian[:, n])
    for d in range(shape.heated.shape[0]):
        respond(size, shape.heated[d], settings.period, width, at, response[d])
    for t in range(terms):
        known = inputs[inputs.shape[0] - terms + t]
        for i in range(n):
            for w in range(width):
                jacobian[i, first - terms + t, w] = known * response[shape.term_place[t], i, w]
    for d in range(turned.shape[0]):
        for i in range(n):
            for w in range(width):
                value = 0.0
                for k in range(n):
                    value += at.shape[k, i, w] * turned[d, k, w]
                jacobian[i, first + d, w] = value
    # D in x' = D (...) depends on the capacitances too.
    for i in range(n):
        if shape.slot[topology.capacitance[i]] >= 0:
            place = first + shape.slot[topology.capacitance[i]]
            for w in range(width):
                jacobian[i, place, w] -= 0.5 * later[i, w]


@njit(**PART)
def _predict_covariance(size, covariance, jacobian, decay, gains, width, product, out):  # type: ignore[no-untyped-def]
    """`out` = F P F^T, packed (n_z (n_z + 1) / 2, WIDTH) as P is.

    F is `jacobian` (n, n_z, WIDTH), then the `decay` (WIDTH,) of the gain, then 1; `product` (n, n_z, WIDTH) is memory.
    """
    n, whole = len(size), jacobian.shape[1]
    for j in range(whole):
        for i in range(n):
            for w in range(width):
                product[i, j, w] = 0.0
    for k in range(whole):
        for j in range(whole):
            row = place_of(k, j)
            for i in range(n):
                for w in range(width):
                    product[i, j, w] += jacobian[i, k, w] * covariance[row, w]
    t = 0
    for i in range(n):
        for j in range(i + 1):
            for w in range(width):
                out[t, w] = 0.0
            for k in range(whole):
                for w in range(width):
                    out[t, w] += product[i, k, w] * jacobian[j, k, w]
            t += 1
    for i in range(n, whole):
        for j in range(i + 1):
            if j < n:
                for w in range(width):
                    out[t, w] = product[j, i, w]
            else:
                for w in range(width):
                    out[t, w] = covariance[t, w]
            if i < n + gains:
                for w in range(width):
                    out[t, w] *= decay[w]
            if n <= j < n + gains:
                for w in range(width):
                    out[t, w] *= decay[w]
            t += 1


@njit(**PART)
def _add_noise(shape, settings, gains, gate, log_alpha, gain_variance, width, out):  # type: ignore[no-untyped-def]
    """Process noise of x, q, c and phi on the diagonal of the packed `out`."""
    n, bounded, terms = shape.block.shape[0], shape.lower.shape[0], shape.coefficient_walk.shape[0]
    for i in range(n):
        for w in range(width):
            alpha = exponential(log_alpha[shape.block[i], w]) if settings.volatile_process else 1.0
            out[place_of(i, i), w] += settings.process_variance * alpha * alpha
    for i in range(n, n + gains):
        for w in range(width):
            out[place_of(i, i), w] += gain_variance[w]
    for d in range(bounded):
        row = place_of(n + gains + d, n + gains + d)
        variance = shape.coefficient_walk[d] if d < terms else gate * gate * settings.parameter_variance
        for w in range(width):
            out[row, w] += variance


@njit(**PART)
def _bound_covariance(shape, whole, width, scale, out):  # type: ignore[no-untyped-def]
    """No coefficient or log parameter varies more than under its prior; `out` is packed, `scale` (WIDTH,) memory."""
    bounded = shape.lower.shape[0]
    for d in range(bounded):
        i, excess = whole - bounded + d, 0
        for w in range(width):
            excess += out[place_of(i, i), w] > shape.prior_variance[d]
        if excess:
            for w in range(width):
                scale[w] = sqrt(min(shape.prior_variance[d] / max(out[place_of(i, i), w], _TINY), 1.0))
            for j in range(whole):
                for w in range(width):
                    out[place_of(i, j), w] *= scale[w] * scale[w] if i == j else scale[w]


@njit(**JIT)
def propagate(size, topology, shape, settings, gate, inputs, normals, uniforms, old, new, worth):  # type: ignore[no-untyped-def]
    """All particles one period on under `inputs` (n_u + m,), from `old` into `new` (`Particles`).

    `size` is a tuple of n_x entries. `worth` (N,) becomes the log of the probability of each particle's gain over that
    of its proposal.
    """
    n, blocks, outputs = len(size), old.log_alpha.shape[0], old.log_noise.shape[0]
    gains, terms, free = old.gain_on.shape[0], shape.term_place.shape[0], shape.free.shape[0]
    whole, particles = old.mean.shape
    known = inputs.shape[0] - terms
    log_begins = log(settings.on_probability / settings.proposed_on_probability)
    log_stays = log((1.0 - settings.on_probability) / (1.0 - settings.proposed_on_probability))
    at, theta = memory(size), np.empty((shape.fixed.shape[0], WIDTH))
    bent, turned, response = (
        np.empty((n, n, WIDTH)),
        np.empty((free, n, WIDTH)),
        np.empty((shape.heated.shape[0], n, WIDTH)),
    )
    jacobian, product = np.empty((n, whole, WIDTH)), np.empty((n, whole, WIDTH))
    mean, later, log_alpha = np.empty((whole, WIDTH)), np.empty((n, WIDTH)), np.empty((blocks, WIDTH))
    covariance, grown = np.empty((old.covariance.shape[0], WIDTH)), np.empty((old.covariance.shape[0], WIDTH))
    places, hours, decay, gain_variance, scale = (
        np.empty((2, WIDTH)), np.empty(WIDTH), np.empty(WIDTH), np.empty(WIDTH), np.empty(WIDTH)
    )  # fmt: skip
    before, on = np.empty((1, WIDTH)), np.empty(WIDTH)
    fixed_parameters(shape.fixed, theta)
    for first in range(0, particles, WIDTH):
        width = min(WIDTH, particles - first)
        for b in range(blocks):
            for w in range(width):
                log_alpha[b, w] = moved_volatility(
                    old.log_alpha[b, first + w], normals[b, first + w], normals[blocks + b, first + w],
                    uniforms[b, first + w], settings,
                )  # fmt: skip
        store(log_alpha, first, width, new.log_alpha)
        for y in range(outputs):
            for w in range(width):
                value = old.log_noise[y, first + w] + settings.noise_walk * normals[2 * blocks + y, first + w]
                new.log_noise[y, first + w] = clipped(value, settings.noise_low, settings.noise_high)
        load(old.mean, first, width, mean)
        load(old.covariance, first, width, covariance)
        set_parameters(shape, mean[whole - free :], width, theta)
        heat_flow(topology, theta, inputs, width, at)
        for w in range(width):
            worth[first + w] = 0.0
        if gains:
            load(uniforms[blocks : blocks + 2], first, width, places)
            load(old.gain_on, first, width, before)
            for w in range(width):
                value = old.log_hours[0, first + w] + settings.hour_walk * normals[2 * blocks + outputs, first + w]
                hours[w] = clipped(value, settings.hour_low, settings.hour_high)
            _switch(n, places[0], places[1], settings, before[0], on, width, mean, covariance)
            gain_decays(hours, settings, width, decay)
            gain_walks(log_alpha, settings, width, gain_variance)
            for w in range(width):
                gain_variance[w] *= on[w] * gain_variance[w]
                if before[0, w] < 0.5:
                    worth[first + w] = log_begins if on[w] > 0.5 else log_stays
                new.log_hours[0, first + w], new.gain_on[0, first + w] = hours[w], on[w]
            for w in range(width):
                at.flow[settings.gain_node, w] += WATTS * mean[n, w]
        for t in range(terms):
            node, power = shape.heated[shape.term_place[t]], inputs[known + t]
            if power != 0.0:
                for w in range(width):
                    at.flow[node, w] += power * mean[n + gains + t, w]
        modes(size, topology, theta, settings.period, width, at)
        move(size, settings.period, mean, width, at, later)
        _linearise(
            size, topology, shape, settings, theta, inputs, mean, later, whole - free, width,
            at, bent, turned, response, jacobian,
        )  # fmt: skip
        _predict_covariance(size, covariance, jacobian, decay, gains, width, product, grown)
        _add_noise(shape, settings, gains, gate, log_alpha, gain_variance, width, grown)
        if settings.parameter_variance > 0.0 or terms > 0:
            _bound_covariance(shape, whole, width, scale, grown)
        for i in range(n):
            for w in range(width):
                mean[i, w] = later[i, w]
        for i in range(n, n + gains):
            for w in range(width):
                mean[i, w] *= decay[w]
        store(mean, first, width, new.mean)
        store(grown, first, width, new.covariance)


@njit(**JIT)
def assimilate(measured, shape, share, outputs, old, mean, covariance, log_likelihood):  # type: ignore[no-untyped-def]
    """Kalman update of all particles by every output (n_y,) that is not NaN, of phi by its `share`; c and phi are kept
    in their bounds."""
    whole, particles = old.mean.shape
    now, spread, column = np.empty((whole, WIDTH)), np.empty((old.covariance.shape[0], WIDTH)), np.empty((whole, WIDTH))
    innovation, precision, kept, gain = np.empty(WIDTH), np.empty(WIDTH), np.empty(WIDTH), np.empty(WIDTH)
    for first in range(0, particles, WIDTH):
        width = min(WIDTH, particles - first)
        load(old.mean, first, width, now)
        load(old.covariance, first, width, spread)
        for w in range(width):
            log_likelihood[first + w] = 0.0
        for y in range(outputs.shape[0]):
            if not np.isnan(outputs[y]):
                node = measured[y]
                for i in range(whole):
                    for w in range(width):
                        column[i, w] = spread[place_of(i, node), w]
                for w in range(width):
                    noise = exponential(2.0 * old.log_noise[y, first + w])
                    total = column[node, w] + noise
                    innovation[w], precision[w], kept[w] = outputs[y] - now[node, w], 1.0 / total, noise / total
                    log_likelihood[first + w] -= 0.5 * (
                        logarithm(_TWO_PI * total) + innovation[w] * innovation[w] * precision[w]
                    )
                t = 0
                for i in range(whole):
                    for w in range(width):
                        gain[w] = column[i, w] * precision[w]
                    for w in range(width):
                        now[i, w] += gain[w] * innovation[w]
                    for j in range(i + 1):
                        for w in range(width):
                            spread[t, w] -= gain[w] * column[j, w]
                        t += 1
                # P - P P / (P + R) is P R / (P + R), which keeps its digits where P is far above R.
                for i in range(whole):
                    for w in range(width):
                        spread[place_of(i, node), w] = column[i, w] * kept[w]
        if share < 1.0:
            _take_back(old, first, whole - shape.free.shape[0], 1.0 - share, width, now, spread)
        _confine(shape, width, gain, now, spread)
        store(now, first, width, mean)
        store(spread, first, width, covariance)


@njit(**PART)
def _take_back(old, first, start, rest, width, mean, covariance):  # type: ignore[no-untyped-def]
    """The `rest` of an update of the components from `start` on taken back: what they were before is in `old`."""
    for i in range(start, mean.shape[0]):
        for w in range(width):
            mean[i, w] += rest * (old.mean[i, first + w] - mean[i, w])
        for j in range(start, i + 1):
            t = place_of(i, j)
            for w in range(width):
                covariance[t, w] += rest * (old.covariance[t, first + w] - covariance[t, w])


@njit(**PART)
def _confine(shape, width, share, mean, covariance):  # type: ignore[no-untyped-def]
    """What of c and phi left its bounds on its bound, the rest where it is most probable given that, then cut off."""
    whole, bounded = mean.shape[0], shape.lower.shape[0]
    for d in range(bounded):
        i, outside = whole - bounded + d, 0
        for w in range(width):
            excess = clipped(mean[i, w], shape.lower[d], shape.upper[d]) - mean[i, w]
            share[w] = (
                excess / max(covariance[place_of(i, i), w], _TINY) if covariance[place_of(i, i), w] > 0.0 else 0.0
            )
            outside += excess != 0.0
        if outside:
            for j in range(whole):
                for w in range(width):
                    mean[j, w] += covariance[place_of(i, j), w] * share[w]
    for d in range(bounded):
        i = whole - bounded + d
        for w in range(width):
            mean[i, w] = clipped(mean[i, w], shape.lower[d], shape.upper[d])
