"""One network in its modes, compiled: exact zero-order hold and its derivative by the logarithms of its parameters.

With D = C^(-1/2) and dt D G D = V diag(m) V^T, the modal state a = V^T D^(-1) x and modal heat b = dt V^T D r become
exp(-m) a + p b, p = (1 - exp(-m)) / m. A small change K of -dt D G D in modes changes that by (E o K) a + (F o K) b,
element by element, where E and F are the divided differences of exp and of (exp - 1) / its argument (Daleckii and
Krein). K is of rank one for a conductance, and of rank two for a capacitance.

A network comes in as a `Topology` (`estimator.network.assembly`): one compilation serves every network.
"""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array
from estimator.kernels.jit import INLINE

_SWEEPS = 15
"""More sweeps of Jacobi's method than any network needs."""
_CONVERGED = 1e-26
"""Square of an element beside the diagonal, relative to the diagonal, that counts as zero."""
_SERIES_BELOW = 0.03
"""Exponent below which divided differences come from a series; above it a quotient loses no more than two digits."""


class Modes(NamedTuple):
    """One parameter vector's network over one step: memory that the functions below fill, n states.

    `modes` fills the first six and the last, `heat_flow` and `move` the others.
    """

    capacity: Array
    """(n,): C [J/K]."""
    scale: Array
    """(n,): D."""
    exponent: Array
    """(n,): m."""
    shape: Array
    """(n, n): V^T D, a mode a row."""
    decay: Array
    """(n,): exp(-m)."""
    drive: Array
    """(n,): p."""
    flow: Array
    """(n,): heat r [W] into each node, from `heat_flow`."""
    state: Array
    """(n,): a."""
    heat: Array
    """(n,): b."""
    rate: Array
    """(n, n): what Jacobi's method works on."""


@njit(**INLINE)
def memory(n):  # type: ignore[no-untyped-def]
    """Memory for a network of n states."""
    return Modes(
        np.empty(n), np.empty(n), np.empty(n), np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n), np.empty(n),
        np.empty(n),
        np.empty((n, n)),
    )  # fmt: skip


@njit(**INLINE)
def modes(topology, theta, period, at):  # type: ignore[no-untyped-def]
    """The modes of parameters `theta` (n_theta,) over `period` s."""
    n = topology.capacitance.shape[0]
    rate = at.rate
    for i in range(n):
        at.capacity[i] = theta[topology.capacitance[i]]
        at.scale[i] = 1.0 / sqrt(at.capacity[i])
        for j in range(n):
            rate[i, j] = 0.0
    for e in range(topology.edges.shape[0]):
        i, j, value = topology.edges[e, 0], topology.edges[e, 1], period * theta[topology.edges[e, 2]]
        rate[i, i] += value * at.scale[i] * at.scale[i]
        if j < n:
            rate[j, j] += value * at.scale[j] * at.scale[j]
            rate[i, j] -= value * at.scale[i] * at.scale[j]
            rate[j, i] = rate[i, j]
    _diagonalise(rate, at.shape)
    for k in range(n):
        at.exponent[k] = max(rate[k, k], 0.0)
        at.decay[k] = exp(-at.exponent[k])
        at.drive[k] = _decay_difference(at.exponent[k], 1.0, at.decay[k])
        for i in range(n):
            at.shape[k, i] *= at.scale[i]


@njit(**INLINE)
def _diagonalise(rate, vectors):  # type: ignore[no-untyped-def]
    """Jacobi's method: `rate` becomes diagonal, the rows of `vectors` its eigenvectors."""
    n = rate.shape[0]
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        turned = False
        for p in range(n):
            for q in range(p + 1, n):
                if rate[p, q] * rate[p, q] > _CONVERGED * rate[p, p] * rate[q, q]:
                    _rotate(rate, vectors, p, q)
                    turned = True
        if not turned:
            break


@njit(**INLINE)
def _rotate(rate, vectors, p, q):  # type: ignore[no-untyped-def]
    """The rotation of p and q that makes element (p, q) of `rate` vanish."""
    x, gap = rate[p, q], rate[q, q] - rate[p, p]
    root = sqrt(gap * gap + 4.0 * x * x)
    tangent = 2.0 * x / (gap - root if gap < 0.0 else gap + root)
    cosine = 1.0 / sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    rate[p, p] -= tangent * x
    rate[q, q] += tangent * x
    rate[p, q] = rate[q, p] = 0.0
    for k in range(rate.shape[0]):
        if k != p and k != q:
            a, b = rate[k, p], rate[k, q]
            rate[k, p] = rate[p, k] = cosine * a - sine * b
            rate[k, q] = rate[q, k] = sine * a + cosine * b
        a, b = vectors[p, k], vectors[q, k]
        vectors[p, k] = cosine * a - sine * b
        vectors[q, k] = sine * a + cosine * b


@njit(**INLINE)
def _decay_difference(gap, slower, faster):  # type: ignore[no-untyped-def]
    """(slower - faster) / gap, where faster is slower times exp(-gap) and gap >= 0."""
    if gap >= _SERIES_BELOW:
        return (slower - faster) / gap
    series = 1.0
    for k in range(7, 1, -1):
        series = 1.0 - gap / k * series
    return slower * series


@njit(**INLINE)
def _drive_difference(small, large, between, drive):  # type: ignore[no-untyped-def]
    """Divided difference of (exp(z) - 1) / z at -small and -large, 0 <= small <= large.

    `between` is that of exp at the same two, `drive` its p at `small`.
    """
    if large >= _SERIES_BELOW:
        return (drive - between) / large
    # Complete homogeneous polynomials h_k of x and y over (k + 2)!.
    power, polynomial, factorial, series = 1.0, 1.0, 2.0, 0.5
    for k in range(1, 7):
        power *= -small
        polynomial = power - polynomial * large
        factorial *= k + 2.0
        series += polynomial / factorial
    return series


@njit(**INLINE)
def heat_flow(topology, theta, inputs, at):  # type: ignore[no-untyped-def]
    """Heat r [W] into each node from boundaries and heat inputs under `inputs` (n_u,)."""
    n = topology.capacitance.shape[0]
    for i in range(n):
        at.flow[i] = 0.0
    for e in range(topology.edges.shape[0]):
        if topology.edges[e, 1] >= n:
            at.flow[topology.edges[e, 0]] += theta[topology.edges[e, 2]] * inputs[topology.edges[e, 1] - n]
    for e in range(topology.heat.shape[0]):
        gain = topology.heat_gain[e, 0] + topology.heat_gain[e, 1] * theta[topology.heat[e, 2]]
        at.flow[topology.heat[e, 0]] += gain * inputs[topology.heat[e, 1]]


@njit(**INLINE)
def move(period, mean, at, later):  # type: ignore[no-untyped-def]
    """`later` (n,): where the temperatures `mean` (n, ...) are after the step, under `at.flow`."""
    n = at.scale.shape[0]
    for i in range(n):
        later[i] = 0.0
    for k in range(n):
        a, b = 0.0, 0.0
        for i in range(n):
            a += at.shape[k, i] * at.capacity[i] * mean[i]
            b += at.shape[k, i] * at.flow[i]
        at.state[k], at.heat[k] = a, b * period
        mode = at.decay[k] * a + at.drive[k] * at.heat[k]
        for i in range(n):
            later[i] += at.shape[k, i] * mode


@njit(**INLINE)
def transition(at, out):  # type: ignore[no-untyped-def]
    """`out` (n, ...): A_d in its first n columns."""
    n = at.scale.shape[0]
    for i in range(n):
        for j in range(n):
            value = 0.0
            for k in range(n):
                value += at.shape[k, i] * at.decay[k] * at.shape[k, j]
            out[i, j] = value * at.capacity[j]


@njit(**INLINE)
def respond(at, node, scale, out):  # type: ignore[no-untyped-def]
    """`out` (n,): temperatures after the step per unit of a heat into `node`, `scale` W s long."""
    n = at.scale.shape[0]
    for i in range(n):
        out[i] = 0.0
    for k in range(n):
        driven = at.drive[k] * at.shape[k, node] * scale
        for i in range(n):
            out[i] += at.shape[k, i] * driven


@njit(**INLINE)
def bend(at, out):  # type: ignore[no-untyped-def]
    """`out` (n, n): E_kl a_l + F_kl b_l, after `move`."""
    n = at.scale.shape[0]
    for k in range(n):
        for j in range(k + 1):
            fast, slow = (k, j) if at.exponent[k] > at.exponent[j] else (j, k)
            small, large = at.exponent[slow], at.exponent[fast]
            between = _decay_difference(large - small, at.decay[slow], at.decay[fast])
            driven = _drive_difference(small, large, between, at.drive[slow])
            out[k, j] = between * at.state[j] + driven * at.heat[j]
            out[j, k] = between * at.state[k] + driven * at.heat[k]


@njit(**INLINE)
def slopes(topology, slot, theta, period, inputs, mean, bent, at, out):  # type: ignore[no-untyped-def]
    """`out` (d, n): derivatives of the modes after `move` by the logarithms of the free parameters, with `bent` from
    `bend`; `slot` (n_theta,) is the place of an entry of theta among them, -1 for a fixed one."""
    n = at.scale.shape[0]
    for d in range(out.shape[0]):
        for k in range(n):
            out[d, k] = 0.0
    for e in range(topology.edges.shape[0]):
        i, j, entry = topology.edges[e, 0], topology.edges[e, 1], topology.edges[e, 2]
        if slot[entry] >= 0:
            _conductance_slope(i, j, period * theta[entry], inputs, bent, at, out[slot[entry]])
    for e in range(topology.heat.shape[0]):
        entry, factor = topology.heat[e, 2], topology.heat_gain[e, 1]
        if factor != 0.0 and slot[entry] >= 0:
            added = factor * inputs[topology.heat[e, 1]] * period * theta[entry]
            for k in range(n):
                out[slot[entry], k] += added * at.drive[k] * at.shape[k, topology.heat[e, 0]]
    for i in range(n):
        if slot[topology.capacitance[i]] >= 0:
            _capacitance_slope(i, period, mean[i], bent, at, out[slot[topology.capacitance[i]]])


@njit(**INLINE)
def _conductance_slope(i, j, value, inputs, bent, at, out):  # type: ignore[no-untyped-def]
    """Slopes (n,) of the conductance between state i and node j: K = -dt g w w^T, and its boundary's heat."""
    n = at.scale.shape[0]
    for k in range(n):
        turned = 0.0
        for m in range(n):
            across = at.shape[m, i] - at.shape[m, j] if j < n else at.shape[m, i]
            turned += bent[k, m] * across
        across = at.shape[k, i] - at.shape[k, j] if j < n else at.shape[k, i]
        out[k] = -value * across * turned
        if j >= n:
            out[k] += value * inputs[j - n] * at.drive[k] * across


@njit(**INLINE)
def _capacitance_slope(i, period, temperature, bent, at, out):  # type: ignore[no-untyped-def]
    """Slopes (n,) of the capacitance of state i: K_kl = v_k v_l (m_k + m_l) / 2, and D in a and b."""
    n, scale = at.scale.shape[0], at.scale[i]
    held, fed = temperature / scale, at.flow[i] * scale * period
    for k in range(n):
        turned, weighted = 0.0, 0.0
        for m in range(n):
            term = bent[k, m] * at.shape[m, i]
            turned += term
            weighted += term * at.exponent[m]
        whole = (at.exponent[k] * turned + weighted) / scale + at.decay[k] * held - at.drive[k] * fed
        out[k] = 0.5 * at.shape[k, i] / scale * whole
