"""The particle step in NumPy and SciPy: the oracle that the compiled kernel is held to."""

from __future__ import annotations

from scipy.optimize import brentq
from scipy.special import ndtr

from estimator.assembly import Indices, assemble
from estimator.discretise import discretise
from estimator.kalman import Assimilated, kalman_predict, kalman_update
from estimator.liu_west import Kernel, moments, rejuvenate
from estimator.network import Network
from estimator.space import ParameterSpace
from estimator.types import Array


class ReferenceSteps:
    """One network's particle steps, written as the paper writes them."""

    def __init__(self, network: Network, space: ParameterSpace, period: float) -> None:
        self._network, self._space, self._period = network, space, period

    def propagate(
        self, coordinates: Array, mean: Array, covariance: Array, noise: Array, inputs: Array
    ) -> tuple[Array, Array]:
        """Kalman prediction (line 9) of every particle, with its own theta and process variances `noise` (n_x, N)."""
        matrices = assemble(self._network, self._space.parameters(coordinates))
        return kalman_predict(discretise(matrices, self._period), mean, covariance, inputs, noise)

    def assimilate(self, mean: Array, covariance: Array, node: int, y: float, variance: float) -> Assimilated:
        """Kalman measurement update (line 12) of every particle."""
        return kalman_update(mean, covariance, node, y, variance)

    def moments(self, coordinates: Array, weights: Array) -> tuple[Array, Array]:
        """Weighted mean (24) and covariance (25) of the parameter coordinates."""
        return moments(coordinates, weights)

    def rejuvenate(self, coordinates: Array, kernel: Kernel, normals: Array) -> Array:
        """Gated Liu-West rejuvenation (28), kept inside the box."""
        return self._space.confine(rejuvenate(coordinates, kernel, normals))

    def mean_log_parameters(self, coordinates: Array, weights: Array) -> Array:
        """Posterior mean (d,) of phi, the point estimate of (33)."""
        return self._space.log_parameters(coordinates) @ weights

    def gather(self, rows: Array, index: Indices) -> Array:
        """Columns `index` of `rows` (m, N)."""
        return rows[:, index]


def mixture_quantile(level: float, weights: Array, means: Array, sds: Array) -> float:
    """The `level` quantile of a Gaussian mixture (all (N,)): the root of its CDF."""
    used = weights > 0
    weights, means, sds = weights[used] / weights[used].sum(), means[used], sds[used]
    reach = 9.0 * sds
    lower, upper = float((means - reach).min()), float((means + reach).max())
    return float(brentq(lambda y: weights @ ndtr((y - means) / sds) - level, lower, upper, xtol=1e-12, rtol=1e-14))
