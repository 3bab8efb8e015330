"""One network in its modes, compiled: exact zero-order hold and its derivative by the logarithms of its parameters.

With D = C^(-1/2) and dt D G D = V diag(m) V^T, the modal state a = V^T D^(-1) x and modal heat b = dt V^T D r become
exp(-m) a + p b, p = (1 - exp(-m)) / m. A small change K of -dt D G D in modes changes that by (E o K) a + (F o K) b,
element by element, where E and F are the divided differences of exp and of (exp - 1) / its argument (Daleckii and
Krein). K is of rank one for a conductance, and of rank two for a capacitance.

A network comes in as a `Topology` (`estimator.network.assembly`), its n states also as `size`, a tuple of n entries:
one compilation serves every network of as many states. Every array has the particles of a block as its last axis, of
which the first `width` are computed.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array
from estimator.kernels.elementary import exponential
from estimator.kernels.jit import INLINE, PART, WIDTH

_SWEEPS = 15
"""More sweeps of Jacobi's method than any network needs."""
_CONVERGED = 1e-26
"""Square of an element beside the diagonal, relative to the diagonal, that counts as zero."""
_TINY = 1e-300
_SERIES_BELOW = 0.03
"""Exponent below which divided differences come from a series; above it a quotient loses no more than two digits."""


class Modes(NamedTuple):
    """The networks of a block of particles over one step: memory that the functions below fill, n states.

    `modes` fills the first six, `heat_flow` and `move` the next three; the others are in between.
    """

    capacity: Array
    """(n, WIDTH): C [J/K]."""
    scale: Array
    """(n, WIDTH): D."""
    exponent: Array
    """(n, WIDTH): m."""
    shape: Array
    """(n, n, WIDTH): V^T D, a mode a row."""
    decay: Array
    """(n, WIDTH): exp(-m)."""
    drive: Array
    """(n, WIDTH): p."""
    flow: Array
    """(n, WIDTH): heat r [W] into each node, from `heat_flow`."""
    state: Array
    """(n, WIDTH): a."""
    heat: Array
    """(n, WIDTH): b."""
    later: Array
    """(n, WIDTH): a after the step."""
    rate: Array
    """(n, n, WIDTH): dt D G D, of which Jacobi's method takes the lower triangle."""
    cosine: Array
    sine: Array
    """(WIDTH,): of a rotation."""


@njit(**INLINE)
def memory(size):  # type: ignore[no-untyped-def]
    """Memory for networks of len(`size`) states."""
    n = len(size)
    return Modes(
        np.empty((n, WIDTH)), np.empty((n, WIDTH)), np.empty((n, WIDTH)), np.empty((n, n, WIDTH)), np.empty((n, WIDTH)),
        np.empty((n, WIDTH)), np.empty((n, WIDTH)), np.empty((n, WIDTH)), np.empty((n, WIDTH)), np.empty((n, WIDTH)),
        np.empty((n, n, WIDTH)),
        np.empty(WIDTH), np.empty(WIDTH),
    )  # fmt: skip


@njit(**INLINE)
def modes(size, topology, theta, period, width, at):  # type: ignore[no-untyped-def]
    """The modes of parameters `theta` (n_theta, WIDTH) over `period` s."""
    n, rate = len(size), at.rate
    for i in range(n):
        entry = topology.capacitance[i]
        for w in range(width):
            at.capacity[i, w] = theta[entry, w]
            at.scale[i, w] = 1.0 / sqrt(theta[entry, w])
        for j in range(n):
            for w in range(width):
                rate[i, j, w] = 0.0
    for e in range(topology.edges.shape[0]):
        i, j, entry = topology.edges[e, 0], topology.edges[e, 1], topology.edges[e, 2]
        for w in range(width):
            rate[i, i, w] += period * theta[entry, w] * at.scale[i, w] * at.scale[i, w]
        if j < n:
            for w in range(width):
                rate[j, j, w] += period * theta[entry, w] * at.scale[j, w] * at.scale[j, w]
            for w in range(width):
                rate[j, i, w] -= period * theta[entry, w] * at.scale[i, w] * at.scale[j, w]
    _diagonalise(size, width, at)
    for k in range(n):
        for w in range(width):
            at.exponent[k, w] = max(rate[k, k, w], 0.0)
            at.decay[k, w] = exponential(-at.exponent[k, w])
            at.drive[k, w] = _decay_difference(at.exponent[k, w], 1.0, at.decay[k, w])
        for w in range(width):
            for i in range(n):
                at.shape[k, i, w] *= at.scale[i, w]


@njit(**INLINE)
def _diagonalise(size, width, at):  # type: ignore[no-untyped-def]
    """Jacobi's method: `at.rate` becomes diagonal, the rows of `at.shape` its eigenvectors."""
    n, rate, vectors = len(size), at.rate, at.shape
    for i in range(n):
        for j in range(n):
            for w in range(width):
                vectors[i, j, w] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        turned = False
        for p in range(n):
            for q in range(p):
                if _coupled(rate, p, q, width):
                    turned = True
                    _find_rotation(rate, p, q, width, at.cosine, at.sine)
                    for k in range(n):
                        if k != p and k != q:
                            _rotate(rate, max(k, p), min(k, p), max(k, q), min(k, q), width, at)
                    for w in range(width):
                        for k in range(n):
                            a, b = vectors[p, k, w], vectors[q, k, w]
                            vectors[p, k, w] = at.cosine[w] * a - at.sine[w] * b
                            vectors[q, k, w] = at.sine[w] * a + at.cosine[w] * b
        if not turned:
            break


@njit(**INLINE)
def _coupled(rate, p, q, width):  # type: ignore[no-untyped-def]
    """How many particles have an element (p, q) of `rate` (n, n, WIDTH) that does not count as zero."""
    # A view of a row would be counted as one more owner of the memory, which takes longer than the row.
    count = 0
    for w in range(width):
        count += rate[p, q, w] * rate[p, q, w] > _CONVERGED * rate[p, p, w] * rate[q, q, w]
    return count


@njit(**INLINE)
def _find_rotation(rate, p, q, width, cosine, sine):  # type: ignore[no-untyped-def]
    """The rotation that makes the element (p, q) of `rate` vanish, and the diagonal after it."""
    for w in range(width):
        x, gap = rate[p, q, w], rate[q, q, w] - rate[p, p, w]
        root = sqrt(gap * gap + 4.0 * x * x) + _TINY
        tangent = 2.0 * x / (gap - root if gap < 0.0 else gap + root)
        cosine[w] = 1.0 / sqrt(1.0 + tangent * tangent)
        sine[w] = tangent * cosine[w]
        rate[p, p, w] -= tangent * x
        rate[q, q, w] += tangent * x
        rate[p, q, w] = 0.0


@njit(**INLINE)
def _rotate(rate, i, j, k, m, width, at):  # type: ignore[no-untyped-def]
    """The elements (i, j) and (k, m) of `rate` after the rotation."""
    for w in range(width):
        a, b = rate[i, j, w], rate[k, m, w]
        rate[i, j, w] = at.cosine[w] * a - at.sine[w] * b
        rate[k, m, w] = at.sine[w] * a + at.cosine[w] * b


@njit(**INLINE)
def _decay_difference(gap, slower, faster):  # type: ignore[no-untyped-def]
    """(slower - faster) / gap, where faster is slower times exp(-gap) and gap >= 0."""
    small, series = min(gap, _SERIES_BELOW), 1.0
    for k in range(7, 1, -1):
        series = 1.0 - small * (1.0 / k) * series
    return slower * series if gap < _SERIES_BELOW else (slower - faster) / max(gap, _SERIES_BELOW)


@njit(**INLINE)
def _drive_difference(small, large, between, drive):  # type: ignore[no-untyped-def]
    """Divided difference of (exp(z) - 1) / z at -small and -large, 0 <= small <= large.

    `between` is that of exp at the same two, `drive` its p at `small`.
    """
    # Complete homogeneous polynomials h_k of x and y over (k + 2)!.
    x, y = -min(large, _SERIES_BELOW), -min(small, _SERIES_BELOW)
    power, polynomial, factorial, series = 1.0, 1.0, 2.0, 0.5
    for k in range(1, 7):
        power *= y
        polynomial = power + polynomial * x
        factorial *= k + 2.0
        series += polynomial / factorial
    return series if large < _SERIES_BELOW else (drive - between) / max(large, _SERIES_BELOW)


@njit(**PART)
def heat_flow(topology, theta, inputs, width, at):  # type: ignore[no-untyped-def]
    """Heat r [W] into each node from boundaries and heat inputs under `inputs` (n_u,)."""
    n = topology.capacitance.shape[0]
    for i in range(n):
        for w in range(width):
            at.flow[i, w] = 0.0
    for e in range(topology.edges.shape[0]):
        i, j, entry = topology.edges[e, 0], topology.edges[e, 1], topology.edges[e, 2]
        if j >= n:
            for w in range(width):
                at.flow[i, w] += theta[entry, w] * inputs[j - n]
    for e in range(topology.heat.shape[0]):
        i, power, entry = topology.heat[e, 0], inputs[topology.heat[e, 1]], topology.heat[e, 2]
        constant, factor = topology.heat_gain[e, 0], topology.heat_gain[e, 1]
        if factor != 0.0:
            for w in range(width):
                at.flow[i, w] += (constant + factor * theta[entry, w]) * power
        else:
            for w in range(width):
                at.flow[i, w] += constant * power


@njit(**INLINE)
def move(size, period, mean, width, at, out):  # type: ignore[no-untyped-def]
    """`out` (n, WIDTH): where the temperatures `mean` (n, WIDTH) are after the step, under `at.flow`."""
    n = len(size)
    for k in range(n):
        for w in range(width):
            a, b = 0.0, 0.0
            for i in range(n):
                a += at.shape[k, i, w] * at.capacity[i, w] * mean[i, w]
                b += at.shape[k, i, w] * at.flow[i, w]
            at.state[k, w], at.heat[k, w] = a, b * period
            at.later[k, w] = at.decay[k, w] * a + at.drive[k, w] * b * period
    for i in range(n):
        for w in range(width):
            value = 0.0
            for k in range(n):
                value += at.shape[k, i, w] * at.later[k, w]
            out[i, w] = value


@njit(**INLINE)
def transition(size, width, at, out):  # type: ignore[no-untyped-def]
    """`out` (n, ..., WIDTH): A_d in its first n columns."""
    n = len(size)
    for i in range(n):
        for w in range(width):
            for j in range(n):
                value = 0.0
                for k in range(n):
                    value += at.shape[k, i, w] * at.decay[k, w] * at.shape[k, j, w]
                out[i, j, w] = value * at.capacity[j, w]


@njit(**INLINE)
def respond(size, node, scale, width, at, out):  # type: ignore[no-untyped-def]
    """`out` (n, WIDTH): temperatures after the step per unit of a heat into `node`, `scale` W s long."""
    n = len(size)
    for i in range(n):
        for w in range(width):
            value = 0.0
            for k in range(n):
                value += at.shape[k, i, w] * at.drive[k, w] * at.shape[k, node, w]
            out[i, w] = value * scale


@njit(**INLINE)
def bend(size, width, at, out):  # type: ignore[no-untyped-def]
    """`out` (n, n, WIDTH): E_kl a_l + F_kl b_l, after `move`."""
    n = len(size)
    for k in range(n):
        for j in range(k + 1):
            for w in range(width):
                small, large = min(at.exponent[k, w], at.exponent[j, w]), max(at.exponent[k, w], at.exponent[j, w])
                slower, faster = max(at.decay[k, w], at.decay[j, w]), min(at.decay[k, w], at.decay[j, w])
                between = _decay_difference(large - small, slower, faster)
                driven = _drive_difference(small, large, between, max(at.drive[k, w], at.drive[j, w]))
                out[k, j, w] = between * at.state[j, w] + driven * at.heat[j, w]
                out[j, k, w] = between * at.state[k, w] + driven * at.heat[k, w]


@njit(**INLINE)
def slopes(size, topology, slot, theta, period, inputs, mean, bent, width, at, out):  # type: ignore[no-untyped-def]
    """`out` (d, n, WIDTH): derivatives of the modes after `move` by the logarithms of the free parameters.

    `bent` is from `bend`; `slot` (n_theta,) is the place of an entry of theta among them, -1 for a fixed one.
    """
    n = len(size)
    for d in range(out.shape[0]):
        for k in range(n):
            for w in range(width):
                out[d, k, w] = 0.0
    for e in range(topology.edges.shape[0]):
        i, j, entry = topology.edges[e, 0], topology.edges[e, 1], topology.edges[e, 2]
        if slot[entry] >= 0:
            boundary = inputs[j - n] if j >= n else 0.0
            _conductance_slope(size, i, j, theta[entry], period, boundary, bent, width, at, out[slot[entry]])
    for e in range(topology.heat.shape[0]):
        node, entry, factor = topology.heat[e, 0], topology.heat[e, 2], topology.heat_gain[e, 1]
        if factor != 0.0 and slot[entry] >= 0:
            added, slope = factor * inputs[topology.heat[e, 1]] * period, out[slot[entry]]
            for k in range(n):
                for w in range(width):
                    slope[k, w] += added * theta[entry, w] * at.drive[k, w] * at.shape[k, node, w]
    for i in range(n):
        if slot[topology.capacitance[i]] >= 0:
            _capacitance_slope(size, i, period, mean[i], bent, width, at, out[slot[topology.capacitance[i]]])


@njit(**INLINE)
def _conductance_slope(size, i, j, conductance, period, boundary, bent, width, at, out):  # type: ignore[no-untyped-def]
    """Slopes (n, WIDTH) of the `conductance` g between state i and node j: K = -dt g w w^T, and its boundary's heat."""
    n = len(size)
    # A boundary is no state: in place of the other node stands the first one, times zero.
    inside, other = (1.0, j) if j < n else (0.0, 0)
    for k in range(n):
        for w in range(width):
            turned = 0.0
            for m in range(n):
                turned += bent[k, m, w] * (at.shape[m, i, w] - inside * at.shape[m, other, w])
            across = at.shape[k, i, w] - inside * at.shape[k, other, w]
            out[k, w] = period * conductance[w] * across * (boundary * at.drive[k, w] - turned)


@njit(**INLINE)
def _capacitance_slope(size, i, period, temperature, bent, width, at, out):  # type: ignore[no-untyped-def]
    """Slopes (n, WIDTH) of the capacitance of state i: K_kl = v_k v_l (m_k + m_l) / 2, and D in a and b."""
    n = len(size)
    for k in range(n):
        for w in range(width):
            turned, weighted = 0.0, 0.0
            for m in range(n):
                term = bent[k, m, w] * at.shape[m, i, w]
                turned += term
                weighted += term * at.exponent[m, w]
            scale = at.scale[i, w]
            held, fed = temperature[w] / scale, at.flow[i, w] * scale * period
            whole = (at.exponent[k, w] * turned + weighted) / scale + at.decay[k, w] * held - at.drive[k, w] * fed
            out[k, w] = 0.5 * at.shape[k, i, w] / scale * whole
