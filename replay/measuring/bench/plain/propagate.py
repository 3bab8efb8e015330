"""The Kalman prediction of all particles in plain Numba: `estimator.kernels.propagate` without lanes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from estimator.kernels import algebra
from estimator.kernels.algebra import SMALL_NORM, triangle
from estimator.kernels.lanes import JIT
from replay.measuring.bench.plain.elementary import exponential, sigmoid
from replay.measuring.bench.plain.written import WIDTH, Rows, aligned, operation

GROUP = 8
"""Particles that are squared together, as often as the stiffest of them needs."""
_START = np.uint64(0)


class Layout(NamedTuple):
    """First scratch row of each quantity of an n-state network, and the number of rows."""

    conductance: int
    """G, then C^(-1/2) G C^(-1/2) and the exponential made of it."""
    flow: int
    """B u, then x_ss."""
    root: int
    """C, then C^(1/2)."""
    inverse: int
    """C^(-1/2)."""
    norm: int
    noise: int
    mean: int
    covariance: int
    rows: int


def layout(n: int) -> Layout:
    """The scratch rows of an n-state network."""
    sizes = (triangle(n), n, n, n, 1, n, n, triangle(n))
    return Layout(*(sum(sizes[:index]) for index in range(len(sizes) + 1)))


def _layout_of(size: tuple[int, ...]) -> Layout:
    """`layout` of as many states as `size` has entries, as compile-time constants."""
    return layout(len(size))


@overload(_layout_of, jit_options=JIT)
def _compiled_layout(size):  # type: ignore[no-untyped-def]
    rows = layout(size.count)
    return lambda size: rows


def _prepare(rows: Rows, n: int) -> None:
    """x_ss of G x_ss = B u, the symmetric rate matrix and its norm."""
    at = layout(n)
    conductance = rows.read(at.conductance, triangle(n))
    rows.write(at.flow, algebra.steady_state(conductance, rows.read(at.flow, n), n))
    root, inverse = algebra.roots(rows.read(at.root, n))
    rows.write(at.root, root)
    rows.write(at.inverse, inverse)
    rate = algebra.scaled_rate(conductance, inverse, n)
    rows.write(at.conductance, rate)
    rows.write(at.norm, [algebra.norm(rate, n)])


def _exponential(rows: Rows, n: int) -> None:
    """exp(M) - 1 of M, the rate matrix times the row `norm`."""
    at = layout(n)
    [scaling] = rows.read(at.norm, 1)
    scaled = [entry * scaling for entry in rows.read(at.conductance, triangle(n))]
    rows.write(at.conductance, algebra.exponential(scaled, n))


def _double(rows: Rows, n: int) -> None:
    at = layout(n).conductance
    rows.write(at, algebra.doubled(rows.read(at, triangle(n)), n))


def _predict(rows: Rows, n: int) -> None:
    """Mean and packed covariance one step on."""
    at = layout(n)
    decay, root, inverse = rows.read(at.conductance, triangle(n)), rows.read(at.root, n), rows.read(at.inverse, n)
    transition = algebra.transition(decay, root, inverse, n)
    rows.write(at.mean, algebra.predicted_mean(transition, rows.read(at.flow, n), rows.read(at.mean, n), n))
    before, noise = rows.read(at.covariance, triangle(n)), rows.read(at.noise, n)
    rows.write(at.covariance, algebra.predicted_covariance(transition, before, noise, n))


prepare, predict = operation(_prepare, WIDTH), operation(_predict, WIDTH)
small_exponential, double = operation(_exponential, GROUP), operation(_double, GROUP)


@njit(forceinline=True, **JIT)
def row_of(memory, row):  # type: ignore[no-untyped-def]
    """A scratch row."""
    return memory[row * WIDTH : (row + 1) * WIDTH]


@njit(**JIT)
def parameters_of(coordinates, lower, upper, logit, free, first, last, theta):  # type: ignore[no-untyped-def]
    """Rows theta (n_theta), free ones only, of the particles first..last from their coordinates (d, N)."""
    for d in range(free.shape[0]):
        target, source, low, span = row_of(theta, free[d]), coordinates[d, first:last], lower[d], upper[d] - lower[d]
        if logit:
            for w in range(source.shape[0]):
                target[w] = exponential(low + span * sigmoid(source[w]))
        else:
            for w in range(source.shape[0]):
                target[w] = exponential(source[w])


@njit(**JIT)
def assemble_block(at, capacitance, edges, heat, heat_gain, theta, inputs, s):  # type: ignore[no-untyped-def]
    """Rows `conductance`, `flow` and `root`, which is C yet, of a block (3)."""
    n_x = capacitance.shape[0]
    s[at.conductance * WIDTH : at.root * WIDTH] = 0.0
    for i in range(n_x):
        target, source = row_of(s, at.root + i), row_of(theta, capacitance[i])
        for w in range(WIDTH):
            target[w] = source[w]
    for e in range(edges.shape[0]):
        i, j, value = edges[e, 0], edges[e, 1], row_of(theta, edges[e, 2])
        diagonal = row_of(s, at.conductance + i * (i + 1) // 2 + i)
        for w in range(WIDTH):
            diagonal[w] += value[w]
        if j < n_x:
            other, cross = (
                row_of(s, at.conductance + j * (j + 1) // 2 + j),
                row_of(s, at.conductance + j * (j + 1) // 2 + i),
            )
            for w in range(WIDTH):
                other[w] += value[w]
            for w in range(WIDTH):
                cross[w] -= value[w]
        else:
            target, boundary = row_of(s, at.flow + i), inputs[j - n_x]
            for w in range(WIDTH):
                target[w] += value[w] * boundary
    for e in range(heat.shape[0]):
        target, value, power = row_of(s, at.flow + heat[e, 0]), row_of(theta, heat[e, 2]), inputs[heat[e, 1]]
        constant, sign = heat_gain[e, 0], heat_gain[e, 1]
        for w in range(WIDTH):
            target[w] += (constant + sign * value[w]) * power


@njit(**JIT)
def decay_of(size, at, period, s):  # type: ignore[no-untyped-def]
    """Rows `conductance`, the rate matrix, become exp(-period * rate) - 1: scaling and squaring."""
    norms = row_of(s, at.norm)
    for first in range(0, WIDTH, GROUP):
        norm = 0.0
        for w in range(first, first + GROUP):
            norm = max(norm, norms[w])
        scaling = -period
        squarings = 0
        while norm * -scaling > SMALL_NORM:
            scaling *= 0.5
            squarings += 1
        norms[first : first + GROUP] = scaling
        small_exponential(size, s, np.uint64(first))
        for _ in range(squarings):
            double(size, s, np.uint64(first))


@njit(forceinline=True, **JIT)
def copied(source, target):  # type: ignore[no-untyped-def]
    """`target` becomes `source`, as far as both go."""
    for w in range(min(source.shape[0], target.shape[0])):
        target[w] = source[w]


@njit(cache=True, **JIT)
def propagate(  # type: ignore[no-untyped-def]
    size, capacitance, edges, heat, heat_gain,
    lower, upper, logit, free, fixed,
    period, inputs, coordinates, mean, covariance, log_alpha, block, process_variance, out_mean, out_covariance,
):  # fmt: skip
    """Kalman prediction of all particles (Algorithm 1, line 9).

    `size` is a tuple of n_x entries. mean (n_x, N), covariance packed (n_tri, N); `block` (n_x,) is each node's row of
    log_alpha (B, N), so that Q_k is alpha^2 times `process_variance`.
    """
    n_x, particles = mean.shape
    n_tri = covariance.shape[0]
    at = _layout_of(size)
    s, theta = aligned(at.rows), aligned(fixed.shape[0])
    for p in range(fixed.shape[0]):
        row_of(theta, p)[:] = fixed[p]
    for p in free:
        row_of(theta, p)[:] = 1.0
    for first in range(0, particles, WIDTH):
        last = min(first + WIDTH, particles)
        parameters_of(coordinates, lower, upper, logit, free, first, last, theta)
        assemble_block(at, capacitance, edges, heat, heat_gain, theta, inputs, s)
        prepare(size, s, _START)
        decay_of(size, at, period, s)
        for i in range(n_x):
            noise, volatility = row_of(s, at.noise + i), log_alpha[block[i], first:last]
            for w in range(volatility.shape[0]):
                alpha = exponential(volatility[w])
                noise[w] = process_variance * alpha * alpha
            copied(mean[i, first:last], row_of(s, at.mean + i))
        for t in range(n_tri):
            copied(covariance[t, first:last], row_of(s, at.covariance + t))
        predict(size, s, _START)
        for i in range(n_x):
            copied(row_of(s, at.mean + i), out_mean[i, first:last])
        for t in range(n_tri):
            copied(row_of(s, at.covariance + t), out_covariance[t, first:last])
