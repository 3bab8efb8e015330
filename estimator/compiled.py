"""The particle step on the Numba kernels, with the same moves as `reference.ReferenceSteps`."""

from __future__ import annotations

import numpy as np

from estimator import kernels
from estimator.assembly import Indices, topology
from estimator.kalman import Assimilated
from estimator.kernel_propagate import propagate
from estimator.liu_west import Kernel
from estimator.network import Network
from estimator.space import ParameterSpace
from estimator.types import Array


class CompiledSteps:
    """One network's particle steps, compiled; arrays as in `ReferenceSteps`."""

    def __init__(self, network: Network, space: ParameterSpace, period: float) -> None:
        self._topology, self._space, self._period = topology(network), space, float(period)

    def propagate(
        self, coordinates: Array, mean: Array, covariance: Array, noise: Array, inputs: Array
    ) -> tuple[Array, Array]:
        """Kalman prediction (Algorithm 1, line 9)."""
        shape, space = self._topology, self._space
        out_mean, out_covariance = np.empty_like(mean), np.empty_like(covariance)
        propagate(
            shape.capacitance, shape.edges, shape.heat, shape.heat_gain,
            space.lower, space.upper, space.logit, space.free, space.fixed,
            self._period, inputs, coordinates, mean, covariance, noise, out_mean, out_covariance,
        )  # fmt: skip
        return out_mean, out_covariance

    def assimilate(self, mean: Array, covariance: Array, node: int, y: float, variance: float) -> Assimilated:
        """Kalman measurement update (line 12)."""
        out = Assimilated(np.empty_like(mean), np.empty_like(covariance), np.empty(mean.shape[1]))
        kernels.assimilate(int(node), float(y), float(variance), mean, covariance, *out)
        return out

    def moments(self, coordinates: Array, weights: Array) -> tuple[Array, Array]:
        """Weighted mean (24) and covariance (25)."""
        mean, covariance = kernels.weighted_moments(coordinates, weights)
        return mean, covariance

    def rejuvenate(self, coordinates: Array, kernel: Kernel, normals: Array) -> Array:
        """Gated Liu-West rejuvenation (28)."""
        space, out = self._space, np.empty_like(coordinates)
        kernels.rejuvenate(
            kernel.shrink, kernel.mean, kernel.jitter, space.lower, space.upper, space.logit, coordinates, normals, out
        )
        return out

    def mean_log_parameters(self, coordinates: Array, weights: Array) -> Array:
        """Posterior mean (d,) of phi."""
        space = self._space
        mean: Array = kernels.mean_log_parameters(space.lower, space.upper, space.logit, coordinates, weights)
        return mean

    def gather(self, rows: Array, index: Indices) -> Array:
        """Columns `index` of `rows` (m, N)."""
        out = np.empty((len(rows), len(index)))
        kernels.gather(rows, index, out)
        return out
