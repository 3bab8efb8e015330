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

from math import sqrt

import numpy as np

from estimator.arrays import Array
from estimator.gaussian.augmented import AugmentedFilter
from estimator.gaussian.options import UKFOptions
from estimator.gaussian.square_root import Gaussian, triangular_root
from estimator.network.modal import ModalNetwork
from estimator.network.network import Network


class UKF(AugmentedFilter):
    """The UKF of a zone: (16) at the sigma points.

    Points whose parameters lie outside the box use those at its edge.
    """

    mean_is_simulated = False

    def __init__(self, network: Network, period: float, options: UKFOptions) -> None:
        super().__init__(network, period, options)
        self._model, self._reach = ModalNetwork(self.network), options.sigma_reach
        self._noise = np.diag(
            np.repeat([options.process_sd, options.parameter_sd], [self._size, len(self._space.free)])
        )

    def move(self, gaussian: Gaussian, inputs: Array) -> Gaussian:
        """N(s_k) one period on under `inputs` (n_u,)."""
        size, weight = self._size, 0.5 / self._reach**2
        spread = self._reach * gaussian.root.T
        points = gaussian.mean + np.vstack([np.zeros(len(spread)), spread, -spread])
        theta = self._space.parameters(self._space.confine(points[:, size:].T)).T
        points[:, :size] = self._model.modes(theta).step(points[:, :size], inputs, self.period)
        apart = points[1:] - points[0]
        shift = weight * apart.sum(axis=0)
        rows = np.vstack([sqrt(weight) * apart, shift[None], self._noise])
        return Gaussian(points[0] + shift, triangular_root(rows))
