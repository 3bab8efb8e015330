"""The straight-line lane code, run as plain Python, against textbook matrix algebra."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator import unrolled
from estimator.unrolled import LANES, layout, packed, triangle


def rows(scratch, first, count):
    return scratch[first * LANES : (first + count) * LANES].reshape(count, LANES)


def full(packed_rows, n):
    matrix = np.empty((LANES, n, n))
    for i in range(n):
        for j in range(n):
            matrix[:, i, j] = packed_rows[packed(i, j)]
    return matrix


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_a_whole_step_is_the_matrix_exponential_step(n):
    rng, at, size = np.random.default_rng(n), layout(n), (0,) * n
    scratch = np.zeros(at.rows * LANES)
    off = -rng.uniform(0, 1, (n, n, LANES))
    conductance = rows(scratch, at.conductance, triangle(n))
    for i in range(n):
        for j in range(i):
            conductance[packed(i, j)] = off[i, j]
        others = sum((off[max(i, j), min(i, j)] for j in range(n) if j != i), np.zeros(LANES))
        conductance[packed(i, i)] = -others + rng.uniform(0.1, 1, LANES)
    flow, capacitance = rng.normal(size=(n, LANES)), rng.uniform(1, 5, (n, LANES))
    mean, noise = rng.normal(size=(n, LANES)), rng.uniform(0, 1, (n, LANES))
    roots = rng.normal(size=(LANES, n, n))
    covariance = roots @ roots.transpose(0, 2, 1)
    rows(scratch, at.flow, n)[:] = flow
    rows(scratch, at.root, n)[:] = capacitance
    rows(scratch, at.mean, n)[:] = mean
    rows(scratch, at.noise, n)[:] = noise
    for i in range(n):
        for j in range(i + 1):
            rows(scratch, at.covariance, triangle(n))[packed(i, j)] = covariance[:, i, j]
    network = full(conductance, n)

    period, squarings = 0.9, 5
    unrolled.steady_state(size, scratch)
    unrolled.scale(size, scratch)
    norms = rows(scratch, at.norm, 1)[0].copy()
    rows(scratch, at.decay, triangle(n))[:] *= -period / 2**squarings
    unrolled.exponential(size, scratch)
    for _ in range(squarings):
        unrolled.square(size, scratch)
    unrolled.propagate(size, scratch)

    for w in range(0, LANES, 7):
        rate = network[w] / capacitance[:, w][:, None]
        transition = expm(-rate * period)
        steady = np.linalg.solve(network[w], flow[:, w])
        scaled = network[w] / np.sqrt(np.outer(capacitance[:, w], capacitance[:, w]))
        assert norms[w] == pytest.approx(np.abs(scaled).sum(axis=1).max())
        np.testing.assert_allclose(
            rows(scratch, at.mean, n)[:, w], steady + transition @ (mean[:, w] - steady), rtol=1e-10, atol=1e-12
        )
        expected = transition @ covariance[w] @ transition.T + np.diag(noise[:, w])
        found = full(rows(scratch, at.covariance, triangle(n)), n)[w]
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("d", [1, 4])
def test_rejuvenation_is_shrink_centre_and_jitter(d):
    rng = np.random.default_rng(d)
    scratch = rng.normal(size=2 * d * LANES)
    coordinates, normals = (part.reshape(d, LANES).copy() for part in np.split(scratch, 2))
    centre, jitter = rng.normal(size=d), np.tril(rng.normal(size=(d, d)))
    unrolled.rejuvenate((0,) * d, scratch, 0.9, centre, jitter)
    expected = 0.9 * coordinates + centre[:, None] + jitter @ normals
    np.testing.assert_allclose(rows(scratch, 0, d), expected, rtol=1e-12, atol=1e-12)
