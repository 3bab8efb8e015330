"""Numba kernels over all particles: volatility, measurement update, weights, moments, rejuvenation, resampling.

Particles are handled eight at a time (`estimator.kernels.lanes`). Sums run lane by lane and are folded at the end,
always in the same order: the same inputs give the same bits. The Kalman prediction is in `propagate`, the quantiles of
mixtures in `quantiles`.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from estimator.kernels.algebra import packed
from estimator.kernels.draws import walk_draws, write_normals
from estimator.kernels.elementary import exponential, logarithm, sigmoid
from estimator.kernels.lanes import (
    JIT,
    LANES,
    Columns,
    as_value,
    choose_below,
    largest,
    load,
    load_log,
    mask,
    maximum,
    minimum,
    scalars,
    spread,
    square_root,
    store,
    total,
    within,
)
from estimator.kernels.scratch import Rows, aligned, get, put

_INVERSE_TWO_PI = 0.15915494309189535


@njit(cache=True, **JIT)
def walk(seed, step, stream, walk_sd, jump_probability, jump_sd, lower, upper, log_alpha, out):  # type: ignore[no-untyped-def]
    """log alpha (B, N) one step on (21): a normal step, rarely a jump, clipped."""
    blocks, particles = log_alpha.shape
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        for b in range(blocks):
            step_size, jump_size, place = walk_draws(seed, step, stream, 4 * b, first)
            value = load(log_alpha, (b, first), inside) + walk_sd * step_size
            value = choose_below(place, jump_probability, value + jump_sd * jump_size, value)
            store(out, (b, first), inside, minimum(maximum(value, lower), upper))


@njit(cache=True, **JIT)
def assimilate(node, y, variance, mean, covariance, out_mean, out_covariance, log_likelihood):  # type: ignore[no-untyped-def]
    """Kalman update of all particles with one scalar output of state `node` (Algorithm 1, line 12)."""
    n_x, particles = mean.shape
    rows = np.empty(n_x, np.int64)
    for i in range(n_x):
        rows[i] = i * (i + 1) // 2 + node if i >= node else node * (node + 1) // 2 + i
    column = aligned(np.empty((n_x + 1) * LANES))
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        innovation = y - load(mean, (node, first), inside)
        precision = 1.0 / (load(covariance, (rows[node], first), inside) + variance)
        log_density = 0.5 * (logarithm(precision * _INVERSE_TWO_PI) - innovation * innovation * precision)
        store(log_likelihood, (first,), inside, log_density)
        for i in range(n_x):
            put(column, i, load(covariance, (rows[i], first), inside))
        t = 0
        for i in range(n_x):
            gain = get(column, i) * precision
            store(out_mean, (i, first), inside, load(mean, (i, first), inside) + gain * innovation)
            for j in range(i + 1):
                store(out_covariance, (t, first), inside, load(covariance, (t, first), inside) - gain * get(column, j))
                t += 1


@njit(cache=True, **JIT)
def reweigh(log_weights, out, weights):  # type: ignore[no-untyped-def]
    """Normalise `log_weights` (N,) into `out` and exponentiate them into `weights`; not-a-number counts as -inf.

    Returns the log of their sum and the effective sample size.
    """
    particles = log_weights.shape[0]
    running = spread(-np.inf)
    for first in range(0, particles, LANES):
        running = maximum(load_log(log_weights, (first,), within(first, particles)), running)
    highest = largest(running)
    sums = spread(0.0)
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        weight = exponential(load_log(log_weights, (first,), inside) - highest)
        sums = sums + weight
        store(weights, (first,), inside, weight)
    whole = total(sums)
    log_sum = highest + np.log(whole)
    squares = spread(0.0)
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        weight = load(weights, (first,), inside) / whole
        squares = squares + weight * weight
        store(weights, (first,), inside, weight)
        store(out, (first,), inside, maximum(load(log_weights, (first,), inside), -np.inf) - log_sum)
    return log_sum, 1.0 / total(squares)


@njit(cache=True, **JIT)
def predictive(log_weights, variances, noise, weights, sds):  # type: ignore[no-untyped-def]
    """Weights (N,) and standard deviations (N,) of one output, from state `variances` and measurement `noise`."""
    particles = log_weights.shape[0]
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        store(weights, (first,), inside, exponential(load_log(log_weights, (first,), inside)))
        store(sds, (first,), inside, square_root(load(variances, (first,), inside) + noise))


@njit(cache=True, **JIT)
def mean_log_parameters(lower, upper, logit, coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) of phi; the weights sum to 1."""
    size, particles = coordinates.shape
    mean = np.empty(size)
    for i in range(size):
        sums = spread(0.0)
        for first in range(0, particles, LANES):
            inside = within(first, particles)
            z, weight = load(coordinates, (i, first), inside), load(weights, (first,), inside)
            sums = sums + weight * sigmoid(z) if logit else sums + weight * z
        mean[i] = lower[i] + (upper[i] - lower[i]) * total(sums) if logit else total(sums)
    return mean


BLOCKS = 4
"""Blocks of eight particles whose products are added before the running sum is touched."""


@intrinsic
def _add_products(typingctx, size, sums, centred, weighted):  # type: ignore[no-untyped-def]
    """sums (n_tri rows) += the products of all pairs of d rows, BLOCKS blocks each, of `centred` and `weighted`."""

    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        d = sig.args[0].count
        of = [Rows(context, builder, kind, value) for kind, value in zip(sig.args[1:], values[1:], strict=True)]
        left, right = of[1].read(0, d * BLOCKS), of[2].read(0, d * BLOCKS)
        for i in range(d):
            for j in range(i + 1):
                [value] = of[0].read(packed(i, j), 1)
                for block in range(BLOCKS):
                    value = value + left[i * BLOCKS + block] * right[j * BLOCKS + block]
                of[0].write(packed(i, j), [value])
        return context.get_dummy_value()

    return types.void(size, sums, centred, weighted), codegen


@njit(cache=True, **JIT)
def weighted_moments(size, coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) and covariance (d, d) of coordinates (d, N) (24)-(25); `size` has d entries.

    The weights sum to 1.
    """
    d, particles = coordinates.shape
    mean, covariance = np.empty(d), np.empty((d, d))
    sums_of = aligned(np.empty((d * (d + 1) // 2 + 1) * LANES))
    centred = aligned(np.empty((d * BLOCKS + 1) * LANES))
    weighted = aligned(np.empty((d * BLOCKS + 1) * LANES))
    means_of = aligned(np.empty((d + 1) * LANES))
    for i in range(d):
        put(means_of, i, 0.0)
    for t in range(d * (d + 1) // 2):
        put(sums_of, t, 0.0)
    for start in range(0, particles, BLOCKS * LANES):
        for block in range(BLOCKS):
            first = start + block * LANES
            inside = within(first, particles)
            weight = load(weights, (first,), inside)
            for i in range(d):
                # About the first particle: any particle is near enough to the mean for the subtraction below.
                offset = load(coordinates, (i, first), inside) - coordinates[i, 0]
                share = offset * weight
                put(centred, i * BLOCKS + block, offset)
                put(weighted, i * BLOCKS + block, share)
                put(means_of, i, get(means_of, i) + share)
        _add_products(size, sums_of, centred, weighted)
    for i in range(d):
        mean[i] = total(get(means_of, i))
        for j in range(i + 1):
            covariance[i, j] = covariance[j, i] = total(get(sums_of, i * (i + 1) // 2 + j)) - mean[i] * mean[j]
    return mean + coordinates[:, 0], covariance


@intrinsic
def _jitter(typingctx, size, seed, step, stream, shrink, centre, jitter, coordinates, out, first, inside):  # type: ignore[no-untyped-def]
    """out = shrink * coordinates + centre + jitter @ z for the particles first..first+7, with z drawn here."""

    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        d = sig.args[0].count
        here = values[9:]
        old, new = (Columns(context, builder, sig.args[k], [values[k], *here]) for k in (7, 8))
        z = write_normals(builder, values[1:4], here[0], d)
        scale = as_value(context, builder, types.float64, values[4])
        middle, factor = (scalars(context, builder, sig.args[k], values[k]) for k in (5, 6))
        for i in range(d):
            value = scale * old.read(i) + middle(i)
            for k in range(i + 1):
                value = value + z[k] * factor(i * d + k)
            new.write(i, value)
        return context.get_dummy_value()

    words = (types.uint64, types.uint64, types.int64)
    arrays = (centre, jitter, coordinates, out)
    return types.void(size, *words, types.float64, *arrays, types.int64, mask), codegen


@njit(cache=True, **JIT)
def rejuvenate(  # type: ignore[no-untyped-def]
    size, seed, step, stream, shrink, mean, jitter, lower, upper, logit, coordinates, out
):
    """Gated Liu-West draw (28) for all particles, clipped to the box in log coordinates; `size` has d entries."""
    d, particles = coordinates.shape
    centre = (1.0 - shrink) * mean
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        _jitter(size, seed, step, stream, shrink, centre, jitter, coordinates, out, first, inside)
        if not logit:
            for i in range(d):
                clipped = minimum(maximum(load(out, (i, first), inside), lower[i]), upper[i])
                store(out, (i, first), inside, clipped)


@njit(cache=True, **JIT)
def systematic(weights, uniform, index):  # type: ignore[no-untyped-def]
    """`index` (any length) by systematic resampling from `weights` (N,) with one `uniform` draw in [0, 1) (line 14)."""
    particles, count = weights.shape[0], index.shape[0]
    whole = 0.0
    for n in range(particles):
        whole += weights[n]
    cumulated = weights[0]
    source = 0
    for n in range(count):
        position = (n + uniform) / count * whole
        while cumulated <= position and source < particles - 1:
            source += 1
            cumulated += weights[source]
        index[n] = source


@njit(cache=True, **JIT)
def gather(rows, index, out):  # type: ignore[no-untyped-def]
    """Columns `index` of rows (m, N)."""
    for m in range(rows.shape[0]):
        for n in range(index.shape[0]):
            out[m, n] = rows[m, index[n]]
