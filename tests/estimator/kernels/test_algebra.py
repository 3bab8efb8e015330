"""The written-out matrix algebra, computing with arrays over networks, against textbook matrix algebra."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.kernels import algebra
from estimator.kernels.algebra import packed, triangle

COUNT = 40


def full(entries, n):
    matrix = np.empty((COUNT, n, n))
    for i in range(n):
        for j in range(n):
            matrix[:, i, j] = entries[packed(i, j)]
    return matrix


def packed_entries(matrices, n):
    return [matrices[:, i, j] for i in range(n) for j in range(i + 1)]


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_a_whole_step_is_the_matrix_exponential_step(n):
    rng = np.random.default_rng(n)
    conductance = -rng.uniform(0, 1, (COUNT, n, n))
    conductance = np.tril(conductance, -1) + np.tril(conductance, -1).transpose(0, 2, 1)
    diagonal = np.arange(n)
    conductance[:, diagonal, diagonal] = -conductance.sum(axis=2) + rng.uniform(0.1, 1, (COUNT, n))
    flow, capacitance = rng.normal(size=(n, COUNT)), rng.uniform(1, 5, (n, COUNT))
    mean, noise = rng.normal(size=(n, COUNT)), rng.uniform(0, 1, (n, COUNT))
    roots = rng.normal(size=(COUNT, n, n))
    covariance = roots @ roots.transpose(0, 2, 1)

    period, squarings = 0.9, 5
    steady = algebra.steady_state(packed_entries(conductance, n), flow, n)
    root, inverse = algebra.roots(capacitance)
    rate = algebra.scaled_rate(packed_entries(conductance, n), inverse, n)
    decay = algebra.exponential([entry * -period / 2**squarings for entry in rate], n)
    for _ in range(squarings):
        decay = algebra.doubled(decay, n)
    transition = algebra.transition(decay, root, inverse, n)
    predicted = algebra.predicted_mean(transition, steady, mean, n)
    spread = algebra.predicted_covariance(transition, packed_entries(covariance, n), noise, n)

    assert len(spread) == triangle(n)
    scaled = conductance / np.sqrt(capacitance.T[:, :, None] * capacitance.T[:, None, :])
    np.testing.assert_allclose(algebra.norm(rate, n), np.abs(scaled).sum(axis=2).max(axis=1))
    for w in range(COUNT):
        exact = expm(-conductance[w] / capacitance[:, w][:, None] * period)
        rest = np.linalg.solve(conductance[w], flow[:, w])
        np.testing.assert_allclose(
            np.array(predicted)[:, w], rest + exact @ (mean[:, w] - rest), rtol=1e-10, atol=1e-12
        )
        expected = exact @ covariance[w] @ exact.T + np.diag(noise[:, w])
        np.testing.assert_allclose(full(spread, n)[w], expected, rtol=1e-10, atol=1e-12)
