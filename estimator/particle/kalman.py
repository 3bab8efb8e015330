"""Conditional Kalman filter of every particle (Algorithm 1, lines 9, 11 and 12), in NumPy.

Means are (n_x, N). Covariances are packed: the lower triangle row by row, (n_x (n_x + 1) / 2, N), so that a symmetric
matrix cannot lose its symmetry and takes no more memory than it has to.
"""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.kernels.packing import packed
from estimator.network.discretise import Discrete


def pack(full: Array) -> Array:
    """Packed (n_tri, N) from full (N, n_x, n_x) covariances."""
    rows, columns = np.tril_indices(full.shape[1])
    return np.ascontiguousarray(full[:, rows, columns].T)


def unpack(packed: Array) -> Array:
    """Full (N, n_x, n_x) from packed (n_tri, N) covariances."""
    size = int((np.sqrt(8 * len(packed) + 1) - 1) / 2)
    full = np.empty((packed.shape[1], size, size))
    rows, columns = np.tril_indices(size)
    full[:, rows, columns] = packed.T
    full[:, columns, rows] = packed.T
    return full


def kalman_predict(model: Discrete, mean: Array, covariance: Array, inputs: Array, noise: Array) -> tuple[Array, Array]:
    """Mean (n_x, N) and packed covariance one step on, under `inputs` (n_u,) and process variances `noise` (n_x, N)."""
    predicted_mean = (model.transition @ mean.T[:, :, None])[:, :, 0].T + (model.input @ inputs).T
    full = model.transition @ unpack(covariance) @ model.transition.transpose(0, 2, 1)
    diagonal = np.arange(len(mean))
    full[:, diagonal, diagonal] += noise.T
    return predicted_mean, pack(full)


class Assimilated(NamedTuple):
    """Updated mean (n_x, N) and packed covariance, and log N(y; y_hat, S) of every particle (N,)."""

    mean: Array
    covariance: Array
    log_likelihood: Array


def kalman_update(mean: Array, covariance: Array, node: int, y: float, variance: float | Array) -> Assimilated:
    """Assimilate one scalar output `y` of state `node` with measurement `variance` R, one for all or (N,)."""
    column = covariance[[packed(i, node) for i in range(len(mean))]]
    innovation = y - mean[node]
    total = column[node] + variance
    gain = column / total
    updated = covariance.copy()
    for i in range(len(mean)):
        for j in range(i + 1):
            updated[packed(i, j)] -= gain[i] * column[j]
    with np.errstate(over="ignore"):
        # A measurement that is out of this world has a likelihood of zero.
        log_likelihood = -0.5 * (np.log(2 * np.pi * total) + innovation**2 / total)
    return Assimilated(mean + gain * innovation, updated, log_likelihood)
