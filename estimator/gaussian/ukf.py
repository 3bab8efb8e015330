"""Augmented-state unscented Kalman filter (paper 3.3.2), in square-root form.

Sigma points (Julier and Uhlmann) around the mean chi_0 of n components: chi_i = chi_0 +- r L_i, r = sqrt(n + kappa),
weights w = 1 / (2 r^2), and beta = 2 for the central point's share in the covariance. With Y_i the moved points,
D_i = Y_i - Y_0 and e = sum_i w D_i, the transform's mean and covariance are

    Y_0 + e    and    sum_i w D_i D_i^T + (beta - 1) e e^T,

the usual sums with the central weight, which may be large and negative, eliminated. No term is negative, so a QR
decomposition gives the root, whatever r.

The usual r = sqrt(3) matches the kurtosis of a Gaussian, and puts the points of a parameter that only its prior is
known of, uniform in the log box, on the box's two edges.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from estimator.arrays import Array
from estimator.gaussian.augmented import AugmentedFilter, Move
from estimator.gaussian.options import UKFOptions
from estimator.gaussian.square_root import Gaussian, triangular_root
from estimator.network.modal import ModalNetwork
from estimator.network.network import Network
from estimator.network.space import parameter_space


def ukf(network: Network, period: float, options: UKFOptions) -> AugmentedFilter:
    """The UKF of a zone."""
    network = network.validate()
    return AugmentedFilter(network, period, options, _move(network, period, options), mean_is_simulated=False)


def _move(network: Network, period: float, options: UKFOptions) -> Move:
    """(16) at the sigma points. Points whose parameters lie outside the box use those at its edge."""
    model, space = ModalNetwork(network), parameter_space(network, logit=False)
    size, total = len(network.nodes), len(network.nodes) + len(space.free)
    noise = np.diag(np.repeat([options.process_sd, options.parameter_sd], [size, total - size]))
    weight = 0.5 / options.sigma_reach**2

    def move(gaussian: Gaussian, inputs: Array) -> Gaussian:
        spread = options.sigma_reach * gaussian.root.T
        points = gaussian.mean + np.vstack([np.zeros(total), spread, -spread])
        theta = space.parameters(space.confine(points[:, size:].T)).T
        points[:, :size] = model.modes(theta).step(points[:, :size], inputs, period)
        apart = points[1:] - points[0]
        shift = weight * apart.sum(axis=0)
        rows = np.vstack([sqrt(weight) * apart, shift[None], noise])
        return Gaussian(points[0] + shift, triangular_root(rows))

    return move
