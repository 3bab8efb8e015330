"""The Kalman prediction of all particles, compiled: theta, network, exact zero-order hold, mean and covariance.

The topology comes in as index arrays: one cached compilation serves every network with the same number of states.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import intrinsic, overload

from estimator.kernels import algebra
from estimator.kernels.algebra import SMALL_NORM, triangle
from estimator.kernels.elementary import exponential, sigmoid
from estimator.kernels.lanes import JIT, LANES, Columns, largest, load, mask, within
from estimator.kernels.scratch import Rows, aligned, get, operation, put


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
    rows: int


def layout(n: int) -> Layout:
    """The scratch rows of an n-state network."""
    sizes = (triangle(n), n, n, n, 1, n)
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
    at = layout(n).conductance
    rows.write(at, algebra.exponential(rows.read(at, triangle(n)), n))


def _double(rows: Rows, n: int) -> None:
    at = layout(n).conductance
    rows.write(at, algebra.doubled(rows.read(at, triangle(n)), n))


prepare, small_exponential, double = map(operation, (_prepare, _exponential, _double))


@intrinsic
def predict(typingctx, size, scratch, mean, covariance, out_mean, out_covariance, first, inside):  # type: ignore[no-untyped-def]
    """Mean and packed covariance of the particles first..first+7 one step on, with the scratch rows of `Layout`."""

    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        n, at = sig.args[0].count, layout(sig.args[0].count)
        rows = Rows(context, builder, sig.args[1], values[1])
        old_mean, old_covariance, new_mean, new_covariance = (
            Columns(context, builder, kind, [array, *values[6:]])
            for kind, array in zip(sig.args[2:6], values[2:6], strict=True)
        )
        decay, root, inverse = rows.read(at.conductance, triangle(n)), rows.read(at.root, n), rows.read(at.inverse, n)
        transition = algebra.transition(decay, root, inverse, n)
        steady, start = rows.read(at.flow, n), [old_mean.read(i) for i in range(n)]
        for i, value in enumerate(algebra.predicted_mean(transition, steady, start, n)):
            new_mean.write(i, value)
        before, noise = [old_covariance.read(t) for t in range(triangle(n))], rows.read(at.noise, n)
        for t, value in enumerate(algebra.predicted_covariance(transition, before, noise, n)):
            new_covariance.write(t, value)
        return context.get_dummy_value()

    arrays = (mean, covariance, out_mean, out_covariance)
    return types.void(size, scratch, *arrays, types.int64, mask), codegen


@njit(cache=True, **JIT)
def parameters_of(coordinates, lower, upper, logit, free, first, inside, theta):  # type: ignore[no-untyped-def]
    """Rows theta (n_theta), free ones only, of the particles first..first+7 from their coordinates (d, N)."""
    for d in range(free.shape[0]):
        z = load(coordinates, (d, first), inside)
        if logit:
            put(theta, free[d], exponential(lower[d] + (upper[d] - lower[d]) * sigmoid(z)))
        else:
            put(theta, free[d], exponential(z))


@njit(cache=True, **JIT)
def assemble_block(at, capacitance, edges, heat, heat_gain, theta, inputs, s):  # type: ignore[no-untyped-def]
    """Rows `conductance`, `flow` and `root`, which is C yet, of a block (3)."""
    n_x = capacitance.shape[0]
    conductance, flow = at.conductance, at.flow
    for row in range(conductance, at.root):
        put(s, row, 0.0)
    for i in range(n_x):
        put(s, at.root + i, get(theta, capacitance[i]))
    for e in range(edges.shape[0]):
        i, j, value = edges[e, 0], edges[e, 1], get(theta, edges[e, 2])
        diagonal = conductance + i * (i + 1) // 2 + i
        put(s, diagonal, get(s, diagonal) + value)
        if j < n_x:
            other, cross = conductance + j * (j + 1) // 2 + j, conductance + j * (j + 1) // 2 + i
            put(s, other, get(s, other) + value)
            put(s, cross, get(s, cross) - value)
        else:
            put(s, flow + i, get(s, flow + i) + value * inputs[j - n_x])
    for e in range(heat.shape[0]):
        power, row = inputs[heat[e, 1]], flow + heat[e, 0]
        gain = heat_gain[e, 0] + heat_gain[e, 1] * get(theta, heat[e, 2])
        put(s, row, get(s, row) + gain * power)


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
    s = aligned(np.empty((at.rows + 1) * LANES))
    theta = aligned(np.empty((fixed.shape[0] + 1) * LANES))
    for p in range(fixed.shape[0]):
        theta[p * LANES : (p + 1) * LANES] = fixed[p]
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        parameters_of(coordinates, lower, upper, logit, free, first, inside, theta)
        assemble_block(at, capacitance, edges, heat, heat_gain, theta, inputs, s)
        prepare(size, s)
        norm = largest(get(s, at.norm))
        scaling = -period
        squarings = 0
        while norm * -scaling > SMALL_NORM:
            scaling *= 0.5
            squarings += 1
        for row in range(at.conductance, n_tri):
            put(s, row, get(s, row) * scaling)
        small_exponential(size, s)
        for _ in range(squarings):
            double(size, s)
        for i in range(n_x):
            alpha = exponential(load(log_alpha, (block[i], first), inside))
            put(s, at.noise + i, process_variance * alpha * alpha)
        predict(size, s, mean, covariance, out_mean, out_covariance, first, inside)
