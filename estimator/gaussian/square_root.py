"""Gaussian algebra on square roots of covariances: P = L L^T can lose neither its symmetry nor its definiteness."""

from math import log, pi, sqrt
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array


class Gaussian(NamedTuple):
    """N(mean, root root^T): `mean` (n,), `root` (n, n) lower triangular or not."""

    mean: Array
    root: Array


def triangular_root(rows: Array) -> Array:
    """Lower triangular L (n, n) with L L^T = rows^T rows, for `rows` (m, n)."""
    return np.ascontiguousarray(np.asarray(np.linalg.qr(rows, mode="r")).T)


def scalar_update(prior: Gaussian, index: int, y: float, variance: float) -> tuple[Gaussian, float]:
    """Kalman update with a measurement `y` of component `index` with noise `variance`, in Potter's form, and
    log N(y; y_hat, S)."""
    row = prior.root[index]
    total = float(row @ row) + variance
    # In Python's floats an absurd y overflows to infinity; in NumPy's it would also warn.
    innovation = y - float(prior.mean[index])
    gain = (prior.root @ row) / total
    root = prior.root - np.outer(gain, row / (1.0 + sqrt(variance / total)))
    scaled = innovation / sqrt(total)
    mean = prior.mean + gain * innovation if abs(scaled) < _ABSURD else prior.mean
    return Gaussian(mean, root), -0.5 * (log(2 * pi * total) + scaled * scaled)


def condition_on(prior: Gaussian, index: int, value: float) -> Gaussian:
    """The mean moved to where component `index` has `value` and the rest is most probable given that; same spread."""
    row = prior.root[index]
    variance = float(row @ row)
    if variance == 0.0:
        return prior
    return prior._replace(mean=prior.mean + (prior.root @ row) * ((value - float(prior.mean[index])) / variance))


_ABSURD = 1e6
"""Standard deviations beyond which a measurement moves nothing; its likelihood is far below zero's by then."""
