"""Gated Liu-West rejuvenation (paper (24)-(28)), in NumPy."""

from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array
from estimator.kernels.jit import JIT
from estimator.particle.options import Options


class Kernel(NamedTuple):
    """phi' = shrink * phi + (1 - shrink) * mean + jitter @ z: `mean` (d,), `jitter` (d, d) lower triangular."""

    shrink: float
    mean: Array
    jitter: Array
    floored: bool


def moments(coordinates: Array, weights: Array) -> tuple[Array, Array]:
    """Weighted mean (24), shape (d,), and covariance (25), shape (d, d), of `coordinates` (d, N)."""
    mean = coordinates @ weights
    centred = coordinates - mean[:, None]
    return mean, (centred * weights) @ centred.T


def liu_west_kernel(mean: Array, covariance: Array, gate: float, options: Options) -> Kernel:
    """The kernel (27)-(28) for gate g_k.

    With `moment_preserving` the jitter is h_k^2 = 1 - a_k^2, which keeps the covariance; the paper's h_k^2 = g_k h_0^2
    shrinks it for every gate between 0 and 1. A variance below its floor is lifted to it: the jitter is proportional
    to the covariance, so a collapse would otherwise be for ever.
    """
    shrink = 1.0 - gate * (1.0 - options.shrinkage)
    scale = 1.0 - shrink**2 if options.moment_preserving else gate * (1.0 - options.shrinkage**2)
    lift = options.variance_floor - np.diag(covariance)
    lifted = covariance + np.diag(np.maximum(lift, 0.0))
    return Kernel(shrink, mean, _cholesky(scale * lifted), bool((lift > 0).any()))


def rejuvenate(coordinates: Array, kernel: Kernel, normals: Array) -> Array:
    """Draw from (28) for every particle: `coordinates` and standard `normals` are (d, N)."""
    # Not a matrix product of a library, whose threads wait for each other on a busy machine.
    jitter = np.einsum("ij,jn->in", kernel.jitter, normals)
    return kernel.shrink * coordinates + (1.0 - kernel.shrink) * kernel.mean[:, None] + jitter


@njit(**JIT)
def _cholesky(covariance):  # type: ignore[no-untyped-def]
    """Lower factor of a covariance that may be singular: a pivot that rounding made negative counts as zero."""
    size = len(covariance)
    factor = np.zeros_like(covariance)
    for j in range(size):
        pivot = covariance[j, j]
        for k in range(j):
            pivot -= factor[j, k] * factor[j, k]
        if pivot > np.finfo(np.float64).eps * size * covariance[j, j]:
            factor[j, j] = np.sqrt(pivot)
            for i in range(j + 1, size):
                rest = covariance[i, j]
                for k in range(j):
                    rest -= factor[i, k] * factor[j, k]
                factor[i, j] = rest / factor[j, j]
    return factor
