"""The particle step in NumPy and SciPy: the oracle that the compiled kernel is held to."""

import numpy as np

from estimator.arrays import Array, Indices
from estimator.kernels.draws import Draws, Purpose
from estimator.kernels.packing import packed
from estimator.network.assembly import assemble
from estimator.network.discretise import discretise
from estimator.network.network import Network
from estimator.network.space import ParameterSpace
from estimator.particle.kalman import Assimilated, kalman_predict, kalman_update
from estimator.particle.liu_west import Kernel, moments, rejuvenate
from estimator.particle.options import VolatilityOptions
from estimator.particle.volatility import propagate_volatility


class ReferenceSteps:
    """One network's particle steps, written as the paper writes them."""

    def __init__(
        self, network: Network, space: ParameterSpace, period: float, block: Indices, process_sd: float
    ) -> None:
        """`block` (n_x,) is each state's volatility block, `process_sd` [K per step] the root of Q_0's diagonal."""
        self._network, self._space, self._period = network, space, period
        self._block, self._process_sd = block, process_sd

    def walk(self, log_alpha: Array, options: VolatilityOptions, draws: Draws) -> Array:
        """log alpha (B, N) one step on (21) (line 8)."""
        return propagate_volatility(log_alpha, options, draws)

    def propagate(
        self, coordinates: Array, mean: Array, covariance: Array, log_alpha: Array, inputs: Array
    ) -> tuple[Array, Array]:
        """Kalman prediction (line 9) of every particle, its own theta and Q_k = alpha^2 Q_0 (20); log_alpha (B, N)."""
        noise = (np.exp(log_alpha[self._block]) * self._process_sd) ** 2
        matrices = assemble(self._network, self._space.parameters(coordinates))
        return kalman_predict(discretise(matrices, self._period), mean, covariance, inputs, noise)

    def outputs_ahead(
        self,
        coordinates: Array,
        mean: Array,
        covariance: Array,
        log_alpha: Array,
        plan: Array,
        options: VolatilityOptions,
        now: Draws,
        nodes: Indices,
        means: Array,
        variances: Array,
    ) -> None:
        """`means` and `variances` (h, n_y, N) of the states `nodes` after each row of `plan` (h, n_u).

        `now` are the draws of the forecasts that are made at the state's step.
        """
        for ahead, inputs in enumerate(plan):
            draws = Draws(int(now.seed), int(now.step) + ahead + 1, forecast=True)
            log_alpha = self.walk(log_alpha, options, draws)
            mean, covariance = self.propagate(coordinates, mean, covariance, log_alpha, inputs)
            means[ahead], variances[ahead] = mean[nodes], covariance[[packed(node, node) for node in nodes]]

    def assimilate(self, mean: Array, covariance: Array, node: int, y: float, variance: float) -> Assimilated:
        """Kalman measurement update (line 12) of every particle."""
        return kalman_update(mean, covariance, node, y, variance)

    def moments(self, coordinates: Array, weights: Array) -> tuple[Array, Array]:
        """Weighted mean (24) and covariance (25) of the parameter coordinates."""
        return moments(coordinates, weights)

    def rejuvenate(self, coordinates: Array, kernel: Kernel, draws: Draws) -> Array:
        """Gated Liu-West rejuvenation (28), kept inside the box."""
        normals = draws.normals(Purpose.REJUVENATE, coordinates.shape)
        return self._space.confine(rejuvenate(coordinates, kernel, normals))

    def mean_log_parameters(self, coordinates: Array, weights: Array) -> Array:
        """Posterior mean (d,) of phi, the point estimate of (33)."""
        # Summed along each row: a library's matrix product may depend on how many threads it has.
        return np.asarray((self._space.log_parameters(coordinates) * weights).sum(axis=1), dtype=np.float64)
