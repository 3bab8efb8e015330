"""The moves of `ReferenceSteps` that cost most, on the Numba kernels."""

import numpy as np

from estimator.arrays import Array, Indices
from estimator.kernels.draws import Draws, Purpose
from estimator.network.assembly import topology
from estimator.network.network import Network
from estimator.network.space import ParameterSpace
from estimator.particle import kernels
from estimator.particle.kalman import Assimilated
from estimator.particle.liu_west import Kernel
from estimator.particle.options import VolatilityOptions
from estimator.particle.reference import ReferenceSteps


class CompiledSteps(ReferenceSteps):
    """One network's particle steps, compiled; arrays as in `ReferenceSteps`."""

    def __init__(
        self, network: Network, space: ParameterSpace, period: float, block: Indices, process_sd: float
    ) -> None:
        super().__init__(network, space, period, block, process_sd)
        # The kernels are compiled for each number of states: the type of this tuple.
        self._size = (0,) * len(network.nodes)
        self._topology = topology(network)
        self._where = kernels.Space(space.lower, space.upper, space.logit, space.free, space.fixed)

    def walk(self, log_alpha: Array, options: VolatilityOptions, draws: Draws) -> Array:
        """log alpha (B, N) one step on (21)."""
        out = np.empty_like(log_alpha)
        kernels.walk(_volatility(options), _stream(draws, Purpose.WALK), log_alpha, out)
        return out

    def propagate(
        self, coordinates: Array, mean: Array, covariance: Array, log_alpha: Array, inputs: Array
    ) -> tuple[Array, Array]:
        """Kalman prediction (Algorithm 1, line 9)."""
        out = np.empty_like(mean), np.empty_like(covariance)
        kernels.propagate(
            self._size, self._topology, self._where, float(self._period), np.asarray(inputs, dtype=np.float64),
            coordinates, mean, covariance, log_alpha, self._block, self._process_sd**2, *out,
        )  # fmt: skip
        return out

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
        """`means` and `variances` (h, n_y, N) of the states `nodes` after each row of `plan` (h, n_u)."""
        kernels.outputs_ahead(
            self._size, self._topology, self._where, float(self._period), np.ascontiguousarray(plan, dtype=np.float64),
            coordinates, mean, covariance, log_alpha, self._block, self._process_sd**2,
            _volatility(options), _stream(now, Purpose.WALK), nodes, means, variances,
        )  # fmt: skip

    def assimilate(self, mean: Array, covariance: Array, node: int, y: float, variance: float) -> Assimilated:
        """Kalman measurement update (line 12)."""
        out = Assimilated(np.empty_like(mean), np.empty_like(covariance), np.empty(mean.shape[1]))
        kernels.assimilate(int(node), float(y), float(variance), mean, covariance, *out)
        return out

    def rejuvenate(self, coordinates: Array, kernel: Kernel, draws: Draws) -> Array:
        """Gated Liu-West rejuvenation (28), kept inside the box."""
        out = np.empty_like(coordinates)
        kernels.rejuvenate(self._where, kernel, _stream(draws, Purpose.REJUVENATE), coordinates, out)
        return out

    def mean_log_parameters(self, coordinates: Array, weights: Array) -> Array:
        """Posterior mean (d,) of phi."""
        return kernels.mean_log_parameters(self._where, coordinates, weights)

    def moments(self, coordinates: Array, weights: Array) -> tuple[Array, Array]:
        """Weighted mean (24) and covariance (25)."""
        mean, covariance = kernels.weighted_moments(coordinates, weights)
        return mean, covariance


def _volatility(options: VolatilityOptions) -> kernels.Volatility:
    return kernels.Volatility(
        options.volatility_sd, options.jump_probability, options.jump_sd,
        float(np.log(options.alpha_min)), float(np.log(options.alpha_max)),
    )  # fmt: skip


def _stream(draws: Draws, purpose: Purpose) -> kernels.Stream:
    return kernels.Stream(draws.seed, draws.step, draws.stream(purpose))
