"""Numba kernels of the Kalman prediction: theta, network, exact zero-order hold and covariance of every particle.

The topology comes in as index arrays, so one cached compilation serves every network. Particles are handled in blocks
of LANES, the innermost dimension of every scratch array, so that the compiler turns the loops over lanes into vector
instructions.
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np
from numba import njit

from estimator.kernels import LANES

_SMALL_NORM = 0.25
"""Norm below which the degree-12 Taylor polynomial of exp is exact to rounding: .25^13 / 13! = 2e-18."""

_TAYLOR = np.array(
    [0.0, 1.0, 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720, 1 / 5040, 1 / 40320, 1 / 362880, 1 / 3628800, 1 / 39916800,
     1 / 479001600]
)  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def parameters_of(coordinates, lower, upper, logit, free, fixed, first, count, theta):  # type: ignore[no-untyped-def]
    """theta (n_theta, LANES) of particles first..first+count from their coordinates (d, N)."""
    for p in range(theta.shape[0]):
        for w in range(LANES):
            theta[p, w] = fixed[p]
    for d in range(free.shape[0]):
        p = free[d]
        low, width = lower[d], upper[d] - lower[d]
        for w in range(count):
            phi = coordinates[d, first + w]
            if logit:
                phi = low + width / (1.0 + exp(-phi))
            theta[p, w] = exp(phi)
        for w in range(count, LANES):
            theta[p, w] = theta[p, count - 1]


@njit(cache=True, nogil=True, error_model="numpy")
def assemble_block(capacitance, edges, heat, heat_gain, theta, inputs, root, internal, flow):  # type: ignore[no-untyped-def]
    """sqrt(C) (n_x, L), G_int (n_x, n_x, L) and the heat flow B_u u (n_x, L) of a block (3)."""
    n_x = root.shape[0]
    for i in range(n_x):
        c = capacitance[i]
        for w in range(LANES):
            root[i, w] = sqrt(theta[c, w])
            flow[i, w] = 0.0
        for j in range(n_x):
            for w in range(LANES):
                internal[i, j, w] = 0.0
    for e in range(edges.shape[0]):
        i, j, p = edges[e, 0], edges[e, 1], edges[e, 2]
        if j < n_x:
            for w in range(LANES):
                g = theta[p, w]
                internal[i, i, w] += g
                internal[j, j, w] += g
                internal[i, j, w] -= g
                internal[j, i, w] -= g
        else:
            temperature = inputs[j - n_x]
            for w in range(LANES):
                g = theta[p, w]
                internal[i, i, w] += g
                flow[i, w] += g * temperature
    for e in range(heat.shape[0]):
        i, p = heat[e, 0], heat[e, 2]
        value, constant, sign = inputs[heat[e, 1]], heat_gain[e, 0], heat_gain[e, 1]
        for w in range(LANES):
            flow[i, w] += (constant + sign * theta[p, w]) * value


@njit(cache=True, nogil=True, error_model="numpy")
def steady_state(internal, flow, factor, steady):  # type: ignore[no-untyped-def]
    """x_ss of G_int x_ss = B_u u by Cholesky factorisation, per lane."""
    n_x = flow.shape[0]
    for j in range(n_x):
        for i in range(j, n_x):
            for w in range(LANES):
                factor[i, j, w] = internal[i, j, w]
            for k in range(j):
                for w in range(LANES):
                    factor[i, j, w] -= factor[i, k, w] * factor[j, k, w]
        for w in range(LANES):
            factor[j, j, w] = sqrt(factor[j, j, w])
        for i in range(j + 1, n_x):
            for w in range(LANES):
                factor[i, j, w] /= factor[j, j, w]
    for i in range(n_x):
        for w in range(LANES):
            steady[i, w] = flow[i, w]
        for k in range(i):
            for w in range(LANES):
                steady[i, w] -= factor[i, k, w] * steady[k, w]
        for w in range(LANES):
            steady[i, w] /= factor[i, i, w]
    for i in range(n_x - 1, -1, -1):
        for k in range(i + 1, n_x):
            for w in range(LANES):
                steady[i, w] -= factor[k, i, w] * steady[k, w]
        for w in range(LANES):
            steady[i, w] /= factor[i, i, w]


@njit(cache=True, nogil=True, error_model="numpy")
def symmetric_product(left, right, out):  # type: ignore[no-untyped-def]
    """out = left @ right for commuting symmetric matrices (n, n, L): only the lower triangle is computed."""
    n = out.shape[0]
    for i in range(n):
        for j in range(i + 1):
            for w in range(LANES):
                out[i, j, w] = left[i, 0, w] * right[0, j, w]
            for k in range(1, n):
                for w in range(LANES):
                    out[i, j, w] += left[i, k, w] * right[k, j, w]
            if i != j:
                for w in range(LANES):
                    out[j, i, w] = out[i, j, w]


@njit(cache=True, nogil=True, error_model="numpy")
def add_polynomial(coefficients, first, powers, out):  # type: ignore[no-untyped-def]
    """out += sum_r coefficients[first + r] * M^r for r = 0..3, with powers = (M, M^2, M^3)."""
    n = out.shape[0]
    for i in range(n):
        for w in range(LANES):
            out[i, i, w] += coefficients[first]
        for j in range(n):
            c1, c2, c3 = coefficients[first + 1], coefficients[first + 2], coefficients[first + 3]
            for w in range(LANES):
                out[i, j, w] += c1 * powers[0, i, j, w] + c2 * powers[1, i, j, w] + c3 * powers[2, i, j, w]


@njit(cache=True, nogil=True, error_model="numpy")
def symmetric_exponential(internal, root, period, powers, fourth, decay, work):  # type: ignore[no-untyped-def]
    """decay = exp(-C^(-1/2) G C^(-1/2) dt), by scaling and squaring with a degree-12 Taylor polynomial (5).

    What is squared is F = exp - I, by F <- 2 F + F^2: next to the identity slow modes would lose the digits that
    squaring then magnifies. The scaling is that of the stiffest lane; squaring a matrix that needed less does no harm.
    """
    n = decay.shape[0]
    norm = 0.0
    for i in range(n):
        for j in range(n):
            for w in range(LANES):
                powers[0, i, j, w] = -internal[i, j, w] * period / (root[i, w] * root[j, w])
    for w in range(LANES):
        for i in range(n):
            row = 0.0
            for j in range(n):
                row += abs(powers[0, i, j, w])
            norm = max(norm, row)
    squarings = 0
    scale = 1.0
    while norm * scale > _SMALL_NORM:
        scale *= 0.5
        squarings += 1
    for i in range(n):
        for j in range(n):
            for w in range(LANES):
                powers[0, i, j, w] *= scale
    symmetric_product(powers[0], powers[0], powers[1])
    symmetric_product(powers[0], powers[1], powers[2])
    symmetric_product(powers[1], powers[1], fourth)
    # Paterson-Stockmeyer: ((c12 M^4 + p(8..11)) M^4 + p(4..7)) M^4 + p(0..3).
    for i in range(n):
        for j in range(n):
            for w in range(LANES):
                decay[i, j, w] = _TAYLOR[12] * fourth[i, j, w]
    add_polynomial(_TAYLOR, 8, powers, decay)
    for first in (4, 0):
        symmetric_product(decay, fourth, work)
        for i in range(n):
            for j in range(n):
                for w in range(LANES):
                    decay[i, j, w] = work[i, j, w]
        add_polynomial(_TAYLOR, first, powers, decay)
    for _ in range(squarings):
        symmetric_product(decay, decay, work)
        for i in range(n):
            for j in range(n):
                for w in range(LANES):
                    decay[i, j, w] = 2.0 * decay[i, j, w] + work[i, j, w]
    for i in range(n):
        for w in range(LANES):
            decay[i, i, w] += 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def propagate(  # type: ignore[no-untyped-def]
    capacitance, edges, heat, heat_gain,
    lower, upper, logit, free, fixed,
    period, inputs, coordinates, mean, covariance, noise, out_mean, out_covariance,
):  # fmt: skip
    """Kalman prediction of all particles (Algorithm 1, line 9).

    x' = x_ss + A_d (x - x_ss) and P' = A_d P A_d^T + diag(noise), with A_d = C^(-1/2) decay C^(1/2). mean and noise
    are (n_x, N), covariance is packed (n_tri, N).
    """
    n_x, particles = mean.shape
    theta = np.empty((fixed.shape[0], LANES))
    root = np.empty((n_x, LANES))
    flow = np.empty((n_x, LANES))
    steady = np.empty((n_x, LANES))
    offset = np.empty((n_x, LANES))
    internal = np.empty((n_x, n_x, LANES))
    factor = np.empty((n_x, n_x, LANES))
    powers = np.empty((3, n_x, n_x, LANES))
    fourth = np.empty((n_x, n_x, LANES))
    decay = np.empty((n_x, n_x, LANES))
    work = np.empty((n_x, n_x, LANES))
    for first in range(0, particles, LANES):
        count = min(LANES, particles - first)
        parameters_of(coordinates, lower, upper, logit, free, fixed, first, count, theta)
        assemble_block(capacitance, edges, heat, heat_gain, theta, inputs, root, internal, flow)
        steady_state(internal, flow, factor, steady)
        symmetric_exponential(internal, root, period, powers, fourth, decay, work)
        # From here on everything is in the scaled coordinates C^(1/2) x, in which A_d is the symmetric `decay`.
        for i in range(n_x):
            for w in range(count):
                offset[i, w] = (mean[i, first + w] - steady[i, w]) * root[i, w]
            for w in range(count, LANES):
                offset[i, w] = 0.0
        for i in range(n_x):
            for w in range(LANES):
                flow[i, w] = decay[i, 0, w] * offset[0, w]
            for k in range(1, n_x):
                for w in range(LANES):
                    flow[i, w] += decay[i, k, w] * offset[k, w]
            for w in range(count):
                out_mean[i, first + w] = steady[i, w] + flow[i, w] / root[i, w]
        t = 0
        for i in range(n_x):
            for j in range(i + 1):
                for w in range(count):
                    factor[i, j, w] = covariance[t, first + w] * root[i, w] * root[j, w]
                    factor[j, i, w] = factor[i, j, w]
                for w in range(count, LANES):
                    factor[i, j, w] = 0.0
                    factor[j, i, w] = 0.0
                t += 1
        for i in range(n_x):
            for j in range(n_x):
                for w in range(LANES):
                    work[i, j, w] = decay[i, 0, w] * factor[0, j, w]
                for k in range(1, n_x):
                    for w in range(LANES):
                        work[i, j, w] += decay[i, k, w] * factor[k, j, w]
        t = 0
        for i in range(n_x):
            for j in range(i + 1):
                for w in range(LANES):
                    flow[0, w] = work[i, 0, w] * decay[0, j, w]
                for k in range(1, n_x):
                    for w in range(LANES):
                        flow[0, w] += work[i, k, w] * decay[k, j, w]
                for w in range(count):
                    out_covariance[t, first + w] = flow[0, w] / (root[i, w] * root[j, w])
                t += 1
            for w in range(count):
                out_covariance[t - 1, first + w] += noise[i, first + w]
