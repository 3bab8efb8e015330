"""A block of eight networks in its modes, compiled: exact zero-order hold and its derivative by z = [x, q, c, phi].

With D = C^(-1/2) and dt D G D = V diag(m) V^T, the modal state a = V^T D^(-1) x and modal heat b = dt V^T D r become
exp(-m) a + p b, p = (1 - exp(-m)) / m. A small change K of -dt D G D in modes changes that by (E o K) a + (F o K) b,
element by element, where E and F are the divided differences of exp and of (exp - 1) / its argument (Daleckii and
Krein). K is of rank one for a conductance, and of rank two for a capacitance.

A number here is `lanes`, eight particles at a time; rows of scratch memory hold them (`estimator.scratch`).
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from estimator.kernels.elementary import exponential
from estimator.kernels.lanes import JIT, choose_below, largest, maximum, minimum, spread, square_root
from estimator.kernels.scratch import get, put
from estimator.mixture.model import WATTS

_SWEEPS = 15
"""More sweeps of Jacobi's method than any network needs."""
_CONVERGED = 1e-24
"""Square of what is left beside the diagonal, relative to it, at which the sweeps end."""
_TINY = 1e-300
_SERIES_BELOW = 0.03
"""Exponent below which divided differences come from a series; above it a quotient loses no more than two digits."""


class ModeRows(NamedTuple):
    """First scratch row of each quantity of networks with n states, n_z components and d free parameters."""

    theta: int
    rate: int
    """(n, n): dt D G D; after `diagonalise` m is on its diagonal."""
    vectors: int
    """(n, n): V, then W = D V."""
    scale: int
    """(n,): D."""
    flow: int
    """(n,): heat r [W] into each node."""
    decay: int
    """(n,): exp(-m)."""
    drive: int
    """(n,): p."""
    state: int
    """(n,): a."""
    heat: int
    """(n,): b."""
    bend: int
    """(n, n): E_kl a_l + F_kl b_l."""
    slopes: int
    """(d, n): derivatives of the modes by phi."""
    jacobian: int
    """(n, n_z): dx' / dz."""
    mean: int
    """(n_z,)."""
    later: int
    """(n,): x'."""
    covariance: int
    """(n_z (n_z + 1) / 2,)."""
    product: int
    """(n, n_z): jacobian times covariance."""
    response: int
    """(D, n): x' per W into each state that terms heat."""
    rows: int
    """How many there are."""


def mode_rows(parameters: int, states: int, size: int, free: int, heated: int) -> ModeRows:
    """The scratch rows for so many entries of theta, states, components of z, free parameters and states that terms
    heat."""
    n, square = states, states * states
    triangle = size * (size + 1) // 2
    lengths = (
        parameters, square, square, n, n, n, n, n, n, square, free * n, n * size, size, n, triangle, n * size,
        heated * n,
    )  # fmt: skip
    return ModeRows(*(sum(lengths[:index]) for index in range(len(lengths) + 1)))


@njit(cache=True, **JIT)
def flow(at, states, edges, heat, heat_gain, inputs, s):  # type: ignore[no-untyped-def]
    """Heat r [W] into each node from boundaries and heat inputs under `inputs` (n_u,)."""
    for i in range(states):
        put(s, at.flow + i, 0.0)
    for e in range(edges.shape[0]):
        if edges[e, 1] >= states:
            row = at.flow + edges[e, 0]
            put(s, row, get(s, row) + get(s, at.theta + edges[e, 2]) * inputs[edges[e, 1] - states])
    for e in range(heat.shape[0]):
        row = at.flow + heat[e, 0]
        gain = heat_gain[e, 0] + heat_gain[e, 1] * get(s, at.theta + heat[e, 2])
        put(s, row, get(s, row) + gain * inputs[heat[e, 1]])


@njit(cache=True, **JIT)
def modes(at, capacitance, edges, period, s):  # type: ignore[no-untyped-def]
    """Rows `rate`, `vectors` (W), `scale`, `decay` and `drive` from row `theta`."""
    n = capacitance.shape[0]
    for i in range(n):
        put(s, at.scale + i, 1.0 / square_root(get(s, at.theta + capacitance[i])))
        for j in range(n):
            put(s, at.rate + i * n + j, 0.0)
    for e in range(edges.shape[0]):
        i, j = edges[e, 0], edges[e, 1]
        value = period * get(s, at.theta + edges[e, 2])
        left = get(s, at.scale + i)
        put(s, at.rate + i * n + i, get(s, at.rate + i * n + i) + value * left * left)
        if j < n:
            right = get(s, at.scale + j)
            put(s, at.rate + j * n + j, get(s, at.rate + j * n + j) + value * right * right)
            put(s, at.rate + i * n + j, -1.0 * value * left * right)
            put(s, at.rate + j * n + i, -1.0 * value * left * right)
    _diagonalise(at, n, s)
    for k in range(n):
        m = maximum(get(s, at.rate + k * n + k), 0.0)
        put(s, at.rate + k * n + k, m)
        decay = exponential(-1.0 * m)
        put(s, at.decay + k, decay)
        put(s, at.drive + k, _decay_difference(m, spread(1.0), decay))
        for i in range(n):
            put(s, at.vectors + i * n + k, get(s, at.vectors + i * n + k) * get(s, at.scale + i))


@njit(cache=True, **JIT)
def _diagonalise(at, n, s):  # type: ignore[no-untyped-def]
    """Jacobi's method: `rate` becomes diagonal, `vectors` its eigenvectors in columns."""
    turns = n + 1 - n % 2
    for i in range(n):
        for j in range(n):
            put(s, at.vectors + i * n + j, 1.0 if i == j else 0.0)
    for _ in range(_SWEEPS):
        left = spread(0.0)
        for p in range(n):
            for q in range(p + 1, n):
                x = get(s, at.rate + p * n + q)
                size = get(s, at.rate + p * n + p) * get(s, at.rate + q * n + q) + _TINY
                left = maximum(x * x / size, left)
        if largest(left) < _CONVERGED:
            break
        for turn in range(turns):
            # Pairs of one turn have no row in common, so that the processor need not wait for one to begin the next.
            for p in range(n):
                q = (turn - p) % turns
                if p < q < n:
                    _rotate(at, n, p, q, s)


@njit(cache=True, **JIT)
def _rotate(at, n, p, q, s):  # type: ignore[no-untyped-def]
    """The rotation of p and q that makes element (p, q) of `rate` vanish."""
    x = get(s, at.rate + p * n + q)
    gap = get(s, at.rate + q * n + q) - get(s, at.rate + p * n + p)
    root = square_root(gap * gap + 4.0 * x * x)
    tangent = 2.0 * x / choose_below(gap, 0.0, gap - root, gap + root + _TINY)
    cosine = 1.0 / square_root(1.0 + tangent * tangent)
    sine = tangent * cosine
    put(s, at.rate + p * n + p, get(s, at.rate + p * n + p) - tangent * x)
    put(s, at.rate + q * n + q, get(s, at.rate + q * n + q) + tangent * x)
    put(s, at.rate + p * n + q, 0.0)
    put(s, at.rate + q * n + p, 0.0)
    for k in range(n):
        if k != p and k != q:
            a, b = get(s, at.rate + k * n + p), get(s, at.rate + k * n + q)
            left, right = cosine * a - sine * b, sine * a + cosine * b
            put(s, at.rate + k * n + p, left)
            put(s, at.rate + p * n + k, left)
            put(s, at.rate + k * n + q, right)
            put(s, at.rate + q * n + k, right)
        a, b = get(s, at.vectors + k * n + p), get(s, at.vectors + k * n + q)
        put(s, at.vectors + k * n + p, cosine * a - sine * b)
        put(s, at.vectors + k * n + q, sine * a + cosine * b)


@njit(cache=True, **JIT)
def _decay_difference(gap, slower, faster):  # type: ignore[no-untyped-def]
    """(slower - faster) / gap, where faster is slower times exp(-gap) and gap >= 0."""
    x = -1.0 * minimum(gap, _SERIES_BELOW)
    series = spread(1.0)
    for k in range(7, 1, -1):
        series = 1.0 + x * (1.0 / k) * series
    return choose_below(gap, _SERIES_BELOW, slower * series, (slower - faster) / maximum(gap, _SERIES_BELOW))


@njit(cache=True, **JIT)
def _drive_difference(small, large, between, drive):  # type: ignore[no-untyped-def]
    """Divided difference of (exp(z) - 1) / z at -small and -large, 0 <= small <= large.

    `between` is that of exp at the same two, `drive` its p at `small`.
    """
    x, y = -1.0 * minimum(large, _SERIES_BELOW), -1.0 * minimum(small, _SERIES_BELOW)
    # Complete homogeneous polynomials h_k of x and y over (k + 2)!.
    power, polynomial, factorial = spread(1.0), spread(1.0), 2.0
    series = spread(0.5)
    for k in range(1, 7):
        power = power * y
        polynomial = polynomial * x + power
        factorial *= k + 2.0
        series = series + polynomial * (1.0 / factorial)
    return choose_below(large, _SERIES_BELOW, series, (drive - between) / maximum(large, _SERIES_BELOW))


@njit(cache=True, **JIT)
def transform(at, n, period, s):  # type: ignore[no-untyped-def]
    """Rows `state`, `heat`, `bend` and `later` from x, the first rows of `mean`, and `flow`."""
    for k in range(n):
        a, b = spread(0.0), spread(0.0)
        for i in range(n):
            w, scale = get(s, at.vectors + i * n + k), get(s, at.scale + i)
            a = a + w * get(s, at.mean + i) / (scale * scale)
            b = b + w * get(s, at.flow + i)
        put(s, at.state + k, a)
        put(s, at.heat + k, b * period)
    for k in range(n):
        for j in range(k + 1):
            first, second = get(s, at.rate + k * n + k), get(s, at.rate + j * n + j)
            small, large = minimum(first, second), maximum(first, second)
            slower = maximum(get(s, at.decay + k), get(s, at.decay + j))
            faster = minimum(get(s, at.decay + k), get(s, at.decay + j))
            between = _decay_difference(large - small, slower, faster)
            drive = maximum(get(s, at.drive + k), get(s, at.drive + j))
            driven = _drive_difference(small, large, between, drive)
            put(s, at.bend + k * n + j, between * get(s, at.state + j) + driven * get(s, at.heat + j))
            put(s, at.bend + j * n + k, between * get(s, at.state + k) + driven * get(s, at.heat + k))
    for i in range(n):
        value = spread(0.0)
        for k in range(n):
            mode = get(s, at.decay + k) * get(s, at.state + k) + get(s, at.drive + k) * get(s, at.heat + k)
            value = value + get(s, at.vectors + i * n + k) * mode
        put(s, at.later + i, value)


@njit(cache=True, **JIT)
def respond(at, n, node, scale, row, s):  # type: ignore[no-untyped-def]
    """Rows `row`.. (n,): x' per unit of a heat into `node`, `scale` W s long, after `modes`."""
    for i in range(n):
        value = spread(0.0)
        for k in range(n):
            driven = get(s, at.drive + k) * get(s, at.vectors + node * n + k)
            value = value + get(s, at.vectors + i * n + k) * driven
        put(s, row + i, value * scale)


@njit(cache=True, **JIT)
def linearise(at, shape, period, inputs, gain_node, size, s):  # type: ignore[no-untyped-def]
    """Row `jacobian` (n, n_z) after `modes` and `transform`, under `inputs` (n_u + m,).

    `gain_node` is -1 without a gain.
    """
    capacitance, edges, heat, heat_gain, slot = (
        shape.capacitance, shape.edges, shape.heat, shape.heat_gain, shape.slot
    )  # fmt: skip
    n, first, terms = capacitance.shape[0], size - shape.free.shape[0], shape.term_place.shape[0]
    for row in range(at.slopes, at.jacobian):
        put(s, row, 0.0)
    for e in range(edges.shape[0]):
        if slot[edges[e, 2]] >= 0:
            _conductance_slope(at, n, edges[e, 0], edges[e, 1], edges[e, 2], slot, period, inputs, s)
    for e in range(heat.shape[0]):
        if heat_gain[e, 1] != 0.0 and slot[heat[e, 2]] >= 0:
            added = heat_gain[e, 1] * inputs[heat[e, 1]] * period * get(s, at.theta + heat[e, 2])
            for k in range(n):
                row = at.slopes + slot[heat[e, 2]] * n + k
                put(s, row, get(s, row) + added * get(s, at.drive + k) * get(s, at.vectors + heat[e, 0] * n + k))
    for i in range(n):
        if slot[capacitance[i]] >= 0:
            _capacitance_slope(at, n, i, slot[capacitance[i]], period, s)
    for d in range(shape.heated.shape[0]):
        respond(at, n, shape.heated[d], period, at.response + d * n, s)
    for i in range(n):
        row = at.jacobian + i * size
        for j in range(n):
            value = spread(0.0)
            for k in range(n):
                value = value + get(s, at.vectors + i * n + k) * get(s, at.decay + k) * get(s, at.vectors + j * n + k)
            scale = get(s, at.scale + j)
            put(s, row + j, value / (scale * scale))
        if gain_node >= 0:
            value = spread(0.0)
            for k in range(n):
                driven = get(s, at.drive + k) * get(s, at.vectors + gain_node * n + k)
                value = value + get(s, at.vectors + i * n + k) * driven
            put(s, row + n, value * (WATTS * period))
        for t in range(terms):
            response = get(s, at.response + shape.term_place[t] * n + i)
            put(s, row + first - terms + t, inputs[inputs.shape[0] - terms + t] * response)
        for d in range(size - first):
            value = spread(0.0)
            for k in range(n):
                value = value + get(s, at.vectors + i * n + k) * get(s, at.slopes + d * n + k)
            put(s, row + first + d, value)
        if slot[capacitance[i]] >= 0:
            column = row + first + slot[capacitance[i]]
            put(s, column, get(s, column) - 0.5 * get(s, at.later + i))


@njit(cache=True, **JIT)
def _conductance_slope(at, n, i, j, entry, slot, period, inputs, s):  # type: ignore[no-untyped-def]
    """Row `slopes` of the conductance `entry` between state i and node j: K = -dt g w w^T, and its boundary's heat."""
    value = period * get(s, at.theta + entry)
    for k in range(n):
        bent = spread(0.0)
        for m in range(n):
            across = get(s, at.vectors + i * n + m)
            if j < n:
                across = across - get(s, at.vectors + j * n + m)
            bent = bent + get(s, at.bend + k * n + m) * across
        across = get(s, at.vectors + i * n + k)
        if j < n:
            across = across - get(s, at.vectors + j * n + k)
        slope = -1.0 * value * across * bent
        if j >= n:
            slope = slope + value * inputs[j - n] * get(s, at.drive + k) * across
        put(s, at.slopes + slot[entry] * n + k, slope)


@njit(cache=True, **JIT)
def _capacitance_slope(at, n, i, place, period, s):  # type: ignore[no-untyped-def]
    """Row `slopes` of the capacitance of state i: K_kl = v_k v_l (m_k + m_l) / 2, and D in a and b."""
    scale = get(s, at.scale + i)
    held = get(s, at.mean + i) / scale
    fed = get(s, at.flow + i) * scale * period
    for k in range(n):
        bent, weighted = spread(0.0), spread(0.0)
        for m in range(n):
            term = get(s, at.bend + k * n + m) * get(s, at.vectors + i * n + m)
            bent, weighted = bent + term, weighted + term * get(s, at.rate + m * n + m)
        v = get(s, at.vectors + i * n + k) / scale
        whole = (get(s, at.rate + k * n + k) * bent + weighted) / scale
        whole = whole + get(s, at.decay + k) * held - get(s, at.drive + k) * fed
        put(s, at.slopes + place * n + k, 0.5 * v * whole)
