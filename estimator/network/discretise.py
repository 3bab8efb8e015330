"""Exact zero-order-hold discretisation (paper (5)-(6)), in NumPy.

C^(-1/2) G C^(-1/2) is symmetric, so one symmetric eigendecomposition gives both the matrix exponential and the input
integral without ever inverting G: exp(-lambda dt) and (1 - exp(-lambda dt)) / lambda are safe for any lambda >= 0.
"""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.assembly import Matrices


class Discrete(NamedTuple):
    """x_(k+1) = A_d x_k + B_d u_k for N parameter vectors: (N, n_x, n_x) and (N, n_x, n_u)."""

    transition: Array
    input: Array


def discretise(matrices: Matrices, period: float) -> Discrete:
    """A_d and B_d of (5)-(6) over `period` s."""
    root = np.sqrt(matrices.capacitance)
    rate, vectors = np.linalg.eigh(matrices.internal / (root[:, :, None] * root[:, None, :]))
    rate = np.maximum(rate, 0.0)
    decay = np.exp(-rate * period)
    integral = np.where(rate * period > 1e-12, -np.expm1(-rate * period) / np.where(rate > 0, rate, 1.0), period)
    transition = np.einsum("nij,nj,nkj->nik", vectors, decay, vectors) * root[:, None, :] / root[:, :, None]
    response = np.einsum("nij,nj,nkj->nik", vectors, integral, vectors) / (root[:, :, None] * root[:, None, :])
    return Discrete(transition, response @ matrices.inputs)


def time_constants(matrices: Matrices) -> Array:
    """Time constants in s, fastest first, shape (N, n_x)."""
    root = np.sqrt(matrices.capacitance)
    rate = np.linalg.eigvalsh(matrices.internal / (root[:, :, None] * root[:, None, :]))
    return np.asarray(1.0 / rate[:, ::-1], dtype=np.float64)


def heat_loss(matrices: Matrices, node: int) -> Array:
    """Steady-state heat-loss coefficient [W/K] from `node` to all boundaries held at one temperature, shape (N,)."""
    unit = np.zeros(matrices.capacitance.shape[1])
    unit[node] = 1.0
    rise = np.linalg.solve(matrices.internal, np.broadcast_to(unit[:, None], (len(matrices.internal), len(unit), 1)))
    return np.asarray(1.0 / rise[:, node, 0], dtype=np.float64)
