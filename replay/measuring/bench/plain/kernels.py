"""Volatility, measurement update, weights, moments and rejuvenation: `estimator.kernels.steps` in plain Numba.

Particles are handled a block at a time. A sum over particles is kept as one sum for each place in a block, so that LLVM
can vectorise it without changing its order, and folded at the end. The order of a sum is that of the source, whatever
the width of the machine's registers.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from estimator.kernels.lanes import JIT
from replay.measuring.bench.plain.draws import normal_pair, uniform, words
from replay.measuring.bench.plain.elementary import exponential, logarithm, sigmoid

WIDTH = 64
"""Particles of a block."""
_W, _2W, _3W = np.uint64(WIDTH), np.uint64(2 * WIDTH), np.uint64(3 * WIDTH)
"""Where the rows of a block begin; unsigned, so that there is no negative index to be looked out for."""
_INVERSE_TWO_PI = 0.15915494309189535


@njit(**JIT)
def total(sums):  # type: ignore[no-untyped-def]
    """Sums, as many as a power of two, folded to one, halves first; `sums` is overwritten."""
    half = sums.shape[0] // 2
    while half:
        for w in range(half):
            sums[w] += sums[w + half]
        half //= 2
    return sums[0]


@njit(forceinline=True, **JIT)
def draw(seed, step, stream, row, first, word, normal):  # type: ignore[no-untyped-def]
    """The draws of four rows from `row` on, for WIDTH particles from `first` on.

    `word` (4 WIDTH,) uint32 becomes the words and `normal` (4 WIDTH,) float32 the standard normals made of them: loops
    of their own, because 32-bit numbers go twice as many to a register as Philox's 64-bit products.
    """
    for w in range(_W):
        word[w], word[_W + w], word[_2W + w], word[_3W + w] = words(seed, step, stream, row, first + w)
    for w in range(_W):
        normal[w], normal[_W + w] = normal_pair(word[w], word[_W + w])
    for w in range(_W):
        normal[_2W + w], normal[_3W + w] = normal_pair(word[_2W + w], word[_3W + w])


@njit(cache=True, **JIT)
def walk(seed, step, stream, walk_sd, jump_probability, jump_sd, lower, upper, log_alpha, out):  # type: ignore[no-untyped-def]
    """log alpha (B, N) one step on (21): a normal step, rarely a jump, clipped."""
    blocks, particles = log_alpha.shape
    word, normal = np.empty(4 * WIDTH, np.uint32), np.empty(4 * WIDTH, np.float32)
    steps, sizes, places = normal[:WIDTH], normal[WIDTH:], word[2 * WIDTH :]
    for first in range(0, particles, WIDTH):
        for b in range(blocks):
            draw(seed, step, stream, 4 * b, np.uint64(first), word, normal)
            old, new = log_alpha[b, first : first + WIDTH], out[b, first : first + WIDTH]
            for w in range(old.shape[0]):
                value = old[w] + walk_sd * steps[w]
                value = value + jump_sd * sizes[w] if uniform(places[w]) < jump_probability else value
                value = value if value > lower else lower
                new[w] = value if value < upper else upper


@njit(cache=True, **JIT)
def assimilate(node, y, variance, mean, covariance, out_mean, out_covariance, log_likelihood):  # type: ignore[no-untyped-def]
    """Kalman update of all particles with one scalar output of state `node` (Algorithm 1, line 12)."""
    n_x, particles = mean.shape
    rows = np.empty(n_x, np.int64)
    for i in range(n_x):
        rows[i] = i * (i + 1) // 2 + node if i >= node else node * (node + 1) // 2 + i
    innovation, precision, gain = np.empty(WIDTH), np.empty(WIDTH), np.empty(WIDTH)
    for first in range(0, particles, WIDTH):
        last = min(first + WIDTH, particles)
        density, expected = log_likelihood[first:last], mean[node, first:last]
        spread = covariance[rows[node], first:last]
        for w in range(last - first):
            innovation[w] = y - expected[w]
            precision[w] = 1.0 / (spread[w] + variance)
            density[w] = 0.5 * (
                logarithm(precision[w] * _INVERSE_TWO_PI) - innovation[w] * innovation[w] * precision[w]
            )
        t = 0
        for i in range(n_x):
            column, old, new = covariance[rows[i], first:last], mean[i, first:last], out_mean[i, first:last]
            for w in range(last - first):
                gain[w] = column[w] * precision[w]
                new[w] = old[w] + gain[w] * innovation[w]
            for j in range(i + 1):
                other = covariance[rows[j], first:last]
                before, after = covariance[t, first:last], out_covariance[t, first:last]
                for w in range(last - first):
                    after[w] = before[w] - gain[w] * other[w]
                t += 1


@njit(cache=True, **JIT)
def reweigh(log_weights, out, weights):  # type: ignore[no-untyped-def]
    """Normalise `log_weights` (N,) into `out` and exponentiate them into `weights`; not-a-number counts as -inf.

    Returns the log of their sum and the effective sample size.
    """
    particles = log_weights.shape[0]
    running, sums, squares = np.full(WIDTH, -np.inf), np.zeros(WIDTH), np.zeros(WIDTH)
    for first in range(0, particles, WIDTH):
        given = log_weights[first : first + WIDTH]
        for w in range(given.shape[0]):
            running[w] = given[w] if given[w] > running[w] else running[w]
    highest = running.max()
    for first in range(0, particles, WIDTH):
        given, weight = log_weights[first : first + WIDTH], weights[first : first + WIDTH]
        for w in range(given.shape[0]):
            value = exponential((given[w] if given[w] > -np.inf else -np.inf) - highest)
            sums[w] += value
            weight[w] = value
    whole = total(sums)
    log_sum = highest + np.log(whole)
    for first in range(0, particles, WIDTH):
        given, weight = log_weights[first : first + WIDTH], weights[first : first + WIDTH]
        normalised = out[first : first + WIDTH]
        for w in range(given.shape[0]):
            share = weight[w] / whole
            squares[w] += share * share
            weight[w] = share
            normalised[w] = (given[w] if given[w] > -np.inf else -np.inf) - log_sum
    return log_sum, 1.0 / total(squares)


@njit(cache=True, **JIT)
def predictive(log_weights, variances, noise, weights, sds):  # type: ignore[no-untyped-def]
    """Weights (N,) and standard deviations (N,) of one output, from state `variances` and measurement `noise`."""
    for n in range(log_weights.shape[0]):
        weights[n] = exponential(log_weights[n])
        sds[n] = np.sqrt(variances[n] + noise)


@njit(cache=True, **JIT)
def mean_log_parameters(lower, upper, logit, coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) of phi; the weights sum to 1."""
    size, particles = coordinates.shape
    mean = np.empty(size)
    sums = np.empty(WIDTH)
    for i in range(size):
        sums[:] = 0.0
        for first in range(0, particles, WIDTH):
            z, weight = coordinates[i, first : first + WIDTH], weights[first : first + WIDTH]
            if logit:
                for w in range(z.shape[0]):
                    sums[w] += weight[w] * sigmoid(z[w])
            else:
                for w in range(z.shape[0]):
                    sums[w] += weight[w] * z[w]
        whole = total(sums)
        mean[i] = lower[i] + (upper[i] - lower[i]) * whole if logit else whole
    return mean


_SUMS = 8
"""Sums of each product of two coordinates: there are too many products for WIDTH sums of each."""


@njit(forceinline=True, **JIT)
def add_products(sums, left, right):  # type: ignore[no-untyped-def]
    """`sums` (_SUMS,) += `left` (WIDTH,) times `right` (WIDTH,), every eighth to the same sum.

    Inlined by force and with its length asked for at run time: LLVM would otherwise unroll the loop over eight sums and
    add one number at a time.
    """
    for lane in range(sums.shape[0]):
        value = sums[lane]
        for k in range(WIDTH // _SUMS):
            value += left[k * _SUMS + lane] * right[k * _SUMS + lane]
        sums[lane] = value


@njit(cache=True, **JIT)
def weighted_moments(coordinates, weights):  # type: ignore[no-untyped-def]
    """Weighted mean (d,) and covariance (d, d) of coordinates (d, N) (24)-(25); the weights sum to 1."""
    d, particles = coordinates.shape
    mean, covariance = np.empty(d), np.empty((d, d))
    sums, means = np.zeros((d, d, _SUMS)), np.zeros((d, WIDTH))
    centred, weighted = np.zeros((d, WIDTH)), np.zeros((d, WIDTH))
    for first in range(0, particles, WIDTH):
        weight = weights[first : first + WIDTH]
        for i in range(d):
            # About the first particle: any particle is near enough to the mean for the subtraction below.
            given, origin = coordinates[i, first : first + WIDTH], coordinates[i, 0]
            offset, share, running = centred[i], weighted[i], means[i]
            for w in range(weight.shape[0]):
                offset[w] = given[w] - origin
                share[w] = offset[w] * weight[w]
                running[w] += share[w]
            share[weight.shape[0] :] = 0.0
        for i in range(d):
            for j in range(i + 1):
                add_products(sums[i, j], centred[i], weighted[j])
    for i in range(d):
        mean[i] = total(means[i])
        for j in range(i + 1):
            covariance[i, j] = covariance[j, i] = total(sums[i, j]) - mean[i] * mean[j]
    return mean + coordinates[:, 0], covariance


@njit(cache=True, **JIT)
def rejuvenate(seed, step, stream, shrink, mean, jitter, lower, upper, logit, coordinates, out):  # type: ignore[no-untyped-def]
    """Gated Liu-West draw (28) for all particles, clipped to the box in log coordinates."""
    d, particles = coordinates.shape
    centre = (1.0 - shrink) * mean
    # Rows are drawn by four and taken by four: each pass over a block then has four products to a sum.
    padded = (d + 3) // 4 * 4
    factor = np.zeros((d, padded))
    factor[:, :d] = jitter
    word, normal = np.empty(4 * WIDTH, np.uint32), np.empty(padded * WIDTH, np.float32)
    moved = np.empty(WIDTH)
    for first in range(0, particles, WIDTH):
        for row in range(0, d, 4):
            draw(seed, step, stream, row, np.uint64(first), word, normal[row * WIDTH : (row + 4) * WIDTH])
        for i in range(d):
            old, new = coordinates[i, first : first + WIDTH], out[i, first : first + WIDTH]
            for w in range(old.shape[0]):
                moved[w] = shrink * old[w] + centre[i]
            for k in range(0, i + 1, 4):
                z = normal[k * WIDTH : (k + 4) * WIDTH]
                f0, f1, f2, f3 = factor[i, k], factor[i, k + 1], factor[i, k + 2], factor[i, k + 3]
                for w in range(_W):
                    value = moved[w] + z[w] * f0
                    value = value + z[_W + w] * f1
                    value = value + z[_2W + w] * f2
                    moved[w] = value + z[_3W + w] * f3
            if logit:
                for w in range(old.shape[0]):
                    new[w] = moved[w]
            else:
                low, high = lower[i], upper[i]
                for w in range(old.shape[0]):
                    value = moved[w] if moved[w] > low else low
                    new[w] = value if value < high else high
