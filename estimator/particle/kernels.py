"""The steps of the particle filter over all particles, compiled (Algorithm 1)."""

from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array, Indices
from estimator.kernels.blocks import fixed_parameters, load, store
from estimator.kernels.draws import fill, normal_pair, padded, uniform, words
from estimator.kernels.elementary import exponential, logarithm, sigmoid
from estimator.kernels.jit import INLINE, JIT, PART, WIDTH
from estimator.kernels.modes import heat_flow, memory, modes, move, transition

_TWO_PI = 6.283185307179586


class Space(NamedTuple):
    """Where theta lives, as in `estimator.network.space.ParameterSpace`."""

    lower: Array
    upper: Array
    logit: bool
    free: Indices
    fixed: Array


class Volatility(NamedTuple):
    """The random walk (21) of log alpha."""

    walk_sd: float
    jump_probability: float
    jump_sd: float
    lower: float
    upper: float


class Stream(NamedTuple):
    """Where draws come from; as in `estimator.kernels.draws.words`."""

    seed: np.uint64
    step: np.uint64
    purpose: int


@njit(**PART)
def _parameters(space, coordinates, first, width, theta):  # type: ignore[no-untyped-def]
    """The free entries of theta from the coordinates (d, N) of a block."""
    begin = np.uint64(first)
    for d in range(space.free.shape[0]):
        entry, lower, extent = space.free[d], space.lower[d], space.upper[d] - space.lower[d]
        if space.logit:
            for w in range(np.uint64(width)):
                theta[entry, w] = exponential(lower + extent * sigmoid(coordinates[d, begin + w]))
        else:
            for w in range(np.uint64(width)):
                theta[entry, w] = exponential(coordinates[d, begin + w])


@njit(**PART)
def _unpack(packed, first, width, out):  # type: ignore[no-untyped-def]
    """`out` (n, n, WIDTH): the full matrices of packed ones (n_tri, N)."""
    t, begin = 0, np.uint64(first)
    for i in range(out.shape[0]):
        for j in range(i + 1):
            for w in range(np.uint64(width)):
                out[i, j, w] = packed[t, begin + w]
            for w in range(np.uint64(width)):
                out[j, i, w] = packed[t, begin + w]
            t += 1


@njit(**INLINE)
def _predict(size, step, covariance, width, half, out):  # type: ignore[no-untyped-def]
    """`out` = A_d P A_d^T, all (n, n, WIDTH)."""
    n = len(size)
    for i in range(n):
        for w in range(width):
            for j in range(n):
                value = 0.0
                for k in range(n):
                    value += step[i, k, w] * covariance[k, j, w]
                half[i, j, w] = value
    for i in range(n):
        for w in range(width):
            for j in range(n):
                value = 0.0
                for k in range(n):
                    value += half[i, k, w] * step[j, k, w]
                out[i, j, w] = value


@njit(**PART)
def _add_noise(variance, log_alpha, at, width, out):  # type: ignore[no-untyped-def]
    """`out` (WIDTH,) += alpha^2 Q_0 (20), with log alpha from column `at` of `log_alpha` on."""
    begin = np.uint64(at)
    for w in range(np.uint64(width)):
        alpha = exponential(log_alpha[begin + w])
        out[w] += variance * alpha * alpha


@njit(**JIT)
def propagate(  # type: ignore[no-untyped-def]
    size, topology, space, period, inputs, coordinates, mean, covariance, log_alpha, block, process_variance,
    out_mean, out_covariance,
):  # fmt: skip
    """Kalman prediction of all particles (line 9).

    `size` is a tuple of n_x entries; mean (n_x, N), covariance packed (n_tri, N); `block` (n_x,) is each node's row of
    log_alpha (B, N), so that Q_k is alpha^2 times `process_variance`.
    """
    n, particles = len(size), mean.shape[1]
    at, theta = memory(size), np.empty((space.fixed.shape[0], WIDTH))
    step, half, spread, grown = (
        np.empty((n, n, WIDTH)), np.empty((n, n, WIDTH)), np.empty((n, n, WIDTH)), np.empty((n, n, WIDTH))
    )  # fmt: skip
    now, later = np.empty((n, WIDTH)), np.empty((n, WIDTH))
    fixed_parameters(space.fixed, theta)
    for first in range(0, particles, WIDTH):
        width = min(WIDTH, particles - first)
        _parameters(space, coordinates, first, width, theta)
        modes(size, topology, theta, period, width, at)
        heat_flow(topology, theta, inputs, width, at)
        load(mean, first, width, now)
        move(size, period, now, width, at, later)
        store(later, first, width, out_mean)
        transition(size, width, at, step)
        _unpack(covariance, first, width, spread)
        _predict(size, step, spread, width, half, grown)
        t = 0
        for i in range(n):
            _add_noise(process_variance, log_alpha[block[i]], first, width, grown[i, i])
            for j in range(i + 1):
                for w in range(width):
                    out_covariance[t, first + w] = grown[i, j, w]
                t += 1


@njit(**JIT)
def outputs_ahead(  # type: ignore[no-untyped-def]
    size, topology, space, period, plan, coordinates, mean, covariance, log_alpha, block, process_variance,
    volatility, stream, nodes, out_means, out_variances,
):  # fmt: skip
    """Means and variances (h, n_y, N) of the states `nodes` after each row of `plan` (h, n_u), from `stream`.step on.

    The other arguments are those of `propagate`.
    """
    n, particles, blocks = len(size), mean.shape[1], log_alpha.shape[0]
    at, theta = memory(size), np.empty((space.fixed.shape[0], WIDTH))
    step, half, spread, grown = (
        np.empty((n, n, WIDTH)), np.empty((n, n, WIDTH)), np.empty((n, n, WIDTH)), np.empty((n, n, WIDTH))
    )  # fmt: skip
    alpha, now, later = np.empty((blocks, WIDTH)), np.empty((n, WIDTH)), np.empty((n, WIDTH))
    fixed_parameters(space.fixed, theta)
    for first in range(0, particles, WIDTH):
        width = min(WIDTH, particles - first)
        _parameters(space, coordinates, first, width, theta)
        modes(size, topology, theta, period, width, at)
        transition(size, width, at, step)
        load(log_alpha, first, width, alpha)
        load(mean, first, width, now)
        _unpack(covariance, first, width, spread)
        for ahead in range(plan.shape[0]):
            for b in range(blocks):
                _walk(volatility, stream, stream.step + np.uint64(ahead + 1), b, first, width, alpha[b], alpha[b], 0)
            heat_flow(topology, theta, plan[ahead], width, at)
            move(size, period, now, width, at, later)
            _predict(size, step, spread, width, half, grown)
            for i in range(n):
                _add_noise(process_variance, alpha[block[i]], 0, width, grown[i, i])
            now, later, spread, grown = later, now, grown, spread
            for y in range(nodes.shape[0]):
                for w in range(width):
                    out_means[ahead, y, first + w] = now[nodes[y], w]
                for w in range(width):
                    out_variances[ahead, y, first + w] = spread[nodes[y], nodes[y], w]


@njit(**PART)
def _walk(volatility, stream, step, block, first, width, log_alpha, out, at):  # type: ignore[no-untyped-def]
    """`out`: log alpha one step on (21), a normal step, rarely a jump, clipped; from column `at` on."""
    particle, begin = np.uint64(first), np.uint64(at)
    for w in range(np.uint64(width)):
        radius, angle, place, _ = words(stream.seed, step, stream.purpose, 4 * block, particle + w)
        size, jump = normal_pair(radius, angle)
        value = log_alpha[begin + w] + volatility.walk_sd * size
        value = value + volatility.jump_sd * jump if uniform(place) < volatility.jump_probability else value
        out[begin + w] = min(max(value, volatility.lower), volatility.upper)


@njit(**JIT)
def walk(volatility, stream, log_alpha, out):  # type: ignore[no-untyped-def]
    """`out`: log alpha (B, N) one step on (21) (line 8)."""
    for b in range(log_alpha.shape[0]):
        _walk(volatility, stream, stream.step, b, 0, log_alpha.shape[1], log_alpha[b], out[b], 0)


@njit(**JIT)
def assimilate(node, y, variance, mean, covariance, out_mean, out_covariance, log_likelihood):  # type: ignore[no-untyped-def]
    """Kalman update of all particles with one output `y` of state `node` (line 12)."""
    n, particles = mean.shape
    rows = np.empty(n, np.int64)
    for i in range(n):
        rows[i] = i * (i + 1) // 2 + node if i >= node else node * (node + 1) // 2 + i
    innovation, precision, gain = np.empty(WIDTH), np.empty(WIDTH), np.empty(WIDTH)
    for first in range(0, particles, WIDTH):
        width = min(WIDTH, particles - first)
        for w in range(width):
            total = covariance[rows[node], first + w] + variance
            innovation[w], precision[w] = y - mean[node, first + w], 1.0 / total
            log_likelihood[first + w] = -0.5 * (
                logarithm(_TWO_PI * total) + innovation[w] * innovation[w] * precision[w]
            )
        t = 0
        for i in range(n):
            for w in range(width):
                gain[w] = covariance[rows[i], first + w] * precision[w]
            for w in range(width):
                out_mean[i, first + w] = mean[i, first + w] + gain[w] * innovation[w]
            for j in range(i + 1):
                for w in range(width):
                    out_covariance[t, first + w] = covariance[t, first + w] - gain[w] * covariance[rows[j], first + w]
                t += 1


@njit(**INLINE)
def _total(sums):  # type: ignore[no-untyped-def]
    """The sum of sums."""
    whole = 0.0
    for w in range(sums.shape[0]):
        whole += sums[w]
    return whole


@njit(**JIT)
def mean_log_parameters(space, coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) of phi; the weights (N,) sum to 1."""
    size, particles = coordinates.shape
    mean, sums = np.empty(size), np.empty(WIDTH)
    for d in range(size):
        sums[:] = 0.0
        for first in range(0, particles, WIDTH):
            width = min(WIDTH, particles - first)
            if space.logit:
                for w in range(width):
                    sums[w] += weights[first + w] * sigmoid(coordinates[d, first + w])
            else:
                for w in range(width):
                    sums[w] += weights[first + w] * coordinates[d, first + w]
        mean[d] = _total(sums)
        if space.logit:
            mean[d] = space.lower[d] + (space.upper[d] - space.lower[d]) * mean[d]
    return mean


@njit(**JIT)
def weighted_moments(coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) and covariance (d, d) of coordinates (d, N) (24)-(25); the weights sum to 1."""
    d, particles = coordinates.shape
    mean, covariance = np.empty(d), np.empty((d, d))
    means, sums, centred, share = np.zeros((d, WIDTH)), np.zeros((d, d, WIDTH)), np.empty((d, WIDTH)), np.empty(WIDTH)
    for first in range(0, particles, WIDTH):
        width = min(WIDTH, particles - first)
        for i in range(d):
            # About the first particle: any particle is near enough to the mean for the subtraction below.
            origin = coordinates[i, 0]
            for w in range(width):
                centred[i, w] = coordinates[i, first + w] - origin
            for w in range(width):
                share[w] = centred[i, w] * weights[first + w]
            for w in range(width):
                means[i, w] += share[w]
            for j in range(i + 1):
                for w in range(width):
                    sums[i, j, w] += share[w] * centred[j, w]
    for i in range(d):
        mean[i] = _total(means[i])
        for j in range(i + 1):
            covariance[i, j] = covariance[j, i] = _total(sums[i, j]) - mean[i] * mean[j]
    return mean + coordinates[:, 0], covariance


@njit(**JIT)
def rejuvenate(space, kernel, stream, coordinates, out):  # type: ignore[no-untyped-def]
    """`out` (d, N): the gated Liu-West draw (28) for all particles, kept inside the box."""
    d, particles = coordinates.shape
    normals = np.empty((padded(d), WIDTH))
    for first in range(0, particles, WIDTH):
        width = min(WIDTH, particles - first)
        fill(stream.seed, stream.step, stream.purpose, True, first, width, normals)
        for i in range(d):
            centre = (1.0 - kernel.shrink) * kernel.mean[i]
            for w in range(width):
                out[i, first + w] = kernel.shrink * coordinates[i, first + w] + centre
            for k in range(i + 1):
                jitter = kernel.jitter[i, k]
                for w in range(width):
                    out[i, first + w] += jitter * normals[k, w]
            if not space.logit:
                for w in range(width):
                    out[i, first + w] = min(max(out[i, first + w], space.lower[i]), space.upper[i])
