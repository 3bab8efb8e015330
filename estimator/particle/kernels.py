"""The Kalman prediction of the particle filter over all particles, and its moments, compiled."""

from __future__ import annotations

from math import exp
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array, Indices
from estimator.kernels.draws import normal_pair, uniform, words
from estimator.kernels.jit import INLINE, JIT
from estimator.kernels.modes import heat_flow, memory, modes, move, transition


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


@njit(**INLINE)
def _parameters(space, coordinates, theta):  # type: ignore[no-untyped-def]
    """The free entries of theta from the coordinates (d,) of a particle."""
    for d in range(space.free.shape[0]):
        phi = coordinates[d]
        if space.logit:
            phi = space.lower[d] + (space.upper[d] - space.lower[d]) / (1.0 + exp(-phi))
        theta[space.free[d]] = exp(phi)


@njit(**INLINE)
def _predict(at_transition, covariance, log_alpha, block, process_variance, product, out):  # type: ignore[no-untyped-def]
    """`out` (n_tri,) = A_d P A_d^T + alpha^2 Q_0 of a packed `covariance` (n_tri,) (20)."""
    n = at_transition.shape[0]
    for i in range(n):
        for j in range(n):
            product[i, j] = 0.0
        t = 0
        for k in range(n):
            for j in range(k):
                product[i, j] += at_transition[i, k] * covariance[t]
                product[i, k] += at_transition[i, j] * covariance[t]
                t += 1
            product[i, k] += at_transition[i, k] * covariance[t]
            t += 1
    t = 0
    for i in range(n):
        for j in range(i + 1):
            value = 0.0
            for k in range(n):
                value += product[i, k] * at_transition[j, k]
            out[t] = value
            t += 1
        alpha = exp(log_alpha[block[i]])
        out[t - 1] += process_variance * alpha * alpha


@njit(**JIT)
def propagate(  # type: ignore[no-untyped-def]
    topology, space, period, inputs, coordinates, mean, covariance, log_alpha, block, process_variance,
    out_mean, out_covariance,
):  # fmt: skip
    """Kalman prediction of all particles (Algorithm 1, line 9).

    mean (n_x, N), covariance packed (n_tri, N); `block` (n_x,) is each node's row of log_alpha (B, N), so that Q_k is
    alpha^2 times `process_variance`.
    """
    n, particles = mean.shape
    at, theta = memory(n), space.fixed.copy()
    step, product = np.empty((n, n)), np.empty((n, n))
    for k in range(particles):
        _parameters(space, coordinates[:, k], theta)
        modes(topology, theta, period, at)
        heat_flow(topology, theta, inputs, at)
        move(period, mean[:, k], at, out_mean[:, k])
        transition(at, step)
        _predict(step, covariance[:, k], log_alpha[:, k], block, process_variance, product, out_covariance[:, k])


@njit(**JIT)
def outputs_ahead(  # type: ignore[no-untyped-def]
    topology, space, period, plan, coordinates, mean, covariance, log_alpha, block, process_variance,
    volatility, seed, origin, stream, nodes, out_means, out_variances,
):  # fmt: skip
    """Means and variances (h, n_y, N) of the states `nodes` after each row of `plan` (h, n_u), from step `origin` on.

    The other arguments are those of `propagate`.
    """
    (n, particles), blocks = mean.shape, log_alpha.shape[0]
    at, theta = memory(n), space.fixed.copy()
    step, product = np.empty((n, n)), np.empty((n, n))
    alpha, now, later = np.empty(blocks), np.empty(n), np.empty(n)
    spread, grown = np.empty(covariance.shape[0]), np.empty(covariance.shape[0])
    for k in range(particles):
        _parameters(space, coordinates[:, k], theta)
        modes(topology, theta, period, at)
        transition(at, step)
        for b in range(blocks):
            alpha[b] = log_alpha[b, k]
        for i in range(n):
            now[i] = mean[i, k]
        for t in range(spread.shape[0]):
            spread[t] = covariance[t, k]
        for ahead in range(plan.shape[0]):
            for b in range(blocks):
                alpha[b] = _walked(alpha[b], volatility, seed, origin + np.uint64(ahead + 1), stream, 4 * b, k)
            heat_flow(topology, theta, plan[ahead], at)
            move(period, now, at, later)
            _predict(step, spread, alpha, block, process_variance, product, grown)
            now, later, spread, grown = later, now, grown, spread
            for y in range(nodes.shape[0]):
                out_means[ahead, y, k] = now[nodes[y]]
                out_variances[ahead, y, k] = spread[nodes[y] * (nodes[y] + 3) // 2]


@njit(**INLINE)
def _walked(log_alpha, volatility, seed, step, stream, row, particle):  # type: ignore[no-untyped-def]
    """log alpha of one particle one step on (21): a normal step, rarely a jump, clipped."""
    radius, angle, place, _ = words(seed, step, stream, row, particle)
    size, jump = normal_pair(radius, angle)
    value = log_alpha + volatility.walk_sd * size
    if uniform(place) < volatility.jump_probability:
        value += volatility.jump_sd * jump
    return min(max(value, volatility.lower), volatility.upper)


@njit(**JIT)
def weighted_moments(coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) and covariance (d, d) of coordinates (d, N) (24)-(25); the weights sum to 1."""
    d, particles = coordinates.shape
    mean, covariance, centred = np.zeros(d), np.zeros((d, d)), np.empty(d)
    for i in range(d):
        for k in range(particles):
            mean[i] += weights[k] * coordinates[i, k]
    for k in range(particles):
        for i in range(d):
            centred[i] = coordinates[i, k] - mean[i]
        for i in range(d):
            for j in range(d):
                covariance[i, j] += weights[k] * centred[i] * centred[j]
    return mean, covariance
