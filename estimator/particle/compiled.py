"""The particle step on the Numba kernels, with the same moves as `reference.ReferenceSteps`."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from estimator.arrays import Array, Indices
from estimator.kernels import quantiles as kernel_quantiles
from estimator.kernels import steps as kernels
from estimator.kernels.ahead import outputs_ahead
from estimator.kernels.algebra import packed
from estimator.kernels.draws import Draws, Purpose
from estimator.kernels.propagate import propagate
from estimator.network.assembly import topology
from estimator.network.network import Network
from estimator.network.space import ParameterSpace
from estimator.particle.kalman import Assimilated
from estimator.particle.liu_west import Kernel
from estimator.particle.options import Options
from estimator.particle.resampling import Weighted
from estimator.types import Mixture

_BINS = 1024


class CompiledSteps:
    """One network's particle steps, compiled; arrays as in `ReferenceSteps`."""

    def __init__(
        self, network: Network, space: ParameterSpace, period: float, block: Indices, process_sd: float
    ) -> None:
        self._topology, self._space, self._period = topology(network), space, float(period)
        self._block, self._process_variance = block, process_sd**2
        # The kernels are compiled per number of states and of free parameters: the types of these tuples.
        self._states = (0,) * len(network.nodes)
        self._free = (0,) * len(space.free)

    def walk(self, log_alpha: Array, options: Options, draws: Draws) -> Array:
        """log alpha (B, N) one step on (21)."""
        out = np.empty_like(log_alpha)
        kernels.walk(
            draws.seed, draws.step, draws.stream(Purpose.WALK),
            options.volatility_sd, options.jump_probability, options.jump_sd,
            np.log(options.alpha_min), np.log(options.alpha_max), log_alpha, out,
        )  # fmt: skip
        return out

    def propagate(
        self, coordinates: Array, mean: Array, covariance: Array, log_alpha: Array, inputs: Array
    ) -> tuple[Array, Array]:
        """Kalman prediction (Algorithm 1, line 9)."""
        shape, space = self._topology, self._space
        out_mean, out_covariance = np.empty_like(mean), np.empty_like(covariance)
        propagate(
            self._states, shape.capacitance, shape.edges, shape.heat, shape.heat_gain,
            space.lower, space.upper, space.logit, space.free, space.fixed,
            self._period, inputs, coordinates, mean, covariance, log_alpha, self._block, self._process_variance,
            out_mean, out_covariance,
        )  # fmt: skip
        return out_mean, out_covariance

    def outputs_ahead(
        self,
        coordinates: Array,
        mean: Array,
        covariance: Array,
        log_alpha: Array,
        plan: Array,
        options: Options,
        now: Draws,
        nodes: Indices,
        means: Array,
        variances: Array,
    ) -> None:
        """`means` and `variances` (h, n_y, N) of the states `nodes` after each row of `plan` (h, n_u)."""
        shape, space = self._topology, self._space
        outputs_ahead(
            self._states, shape.capacitance, shape.edges, shape.heat, shape.heat_gain,
            space.lower, space.upper, space.logit, space.free, space.fixed,
            self._period, np.ascontiguousarray(plan, dtype=np.float64),
            coordinates, mean, covariance, log_alpha, self._block, self._process_variance,
            now.seed, now.step, now.stream(Purpose.WALK),
            options.volatility_sd, options.jump_probability, options.jump_sd,
            np.log(options.alpha_min), np.log(options.alpha_max), nodes, means, variances,
        )  # fmt: skip

    def assimilate(self, mean: Array, covariance: Array, node: int, y: float, variance: float) -> Assimilated:
        """Kalman measurement update (line 12)."""
        out = Assimilated(np.empty_like(mean), np.empty_like(covariance), np.empty(mean.shape[1]))
        kernels.assimilate(int(node), float(y), float(variance), mean, covariance, *out)
        return out

    def predictive(
        self, mean: Array, covariance: Array, log_weights: Array, nodes: Indices, variance: float
    ) -> Mixture:
        """The mixture of line 10 over the outputs `nodes` (n_y,), with measurement `variance` R."""
        weights, sds = np.empty_like(log_weights), np.empty((len(nodes), len(log_weights)))
        for row, node in zip(sds, nodes, strict=True):
            kernels.predictive(log_weights, covariance[packed(node, node)], variance, weights, row)
        return Mixture(weights, mean[nodes], sds)

    def reweigh(self, log_weights: Array) -> Weighted:
        """Weights normalised (line 11)."""
        normalised, weights = np.empty_like(log_weights), np.empty_like(log_weights)
        log_sum, n_eff = kernels.reweigh(log_weights, normalised, weights)
        return Weighted(normalised, weights, log_sum, n_eff)

    def moments(self, coordinates: Array, weights: Array) -> tuple[Array, Array]:
        """Weighted mean (24) and covariance (25)."""
        mean, covariance = kernels.weighted_moments(self._free, coordinates, weights)
        return mean, covariance

    def rejuvenate(self, coordinates: Array, kernel: Kernel, draws: Draws) -> Array:
        """Gated Liu-West rejuvenation (28)."""
        space, out = self._space, np.empty_like(coordinates)
        if self._free:
            kernels.rejuvenate(
                self._free, draws.seed, draws.step, draws.stream(Purpose.REJUVENATE),
                kernel.shrink, kernel.mean, kernel.jitter, space.lower, space.upper, space.logit, coordinates, out,
            )  # fmt: skip
        return out

    def mean_log_parameters(self, coordinates: Array, weights: Array) -> Array:
        """Posterior mean (d,) of phi."""
        space = self._space
        mean: Array = kernels.mean_log_parameters(space.lower, space.upper, space.logit, coordinates, weights)
        return mean

    def systematic(self, weights: Array, uniform: float) -> Indices:
        """Indices (N,) of systematic resampling (line 14)."""
        index = np.empty(len(weights), dtype=np.int64)
        kernels.systematic(weights, uniform, index)
        return index

    def weighted_quantiles(self, values: Array, weights: Array, levels: Array) -> Array:
        """Quantiles (L,) of weighted values (N,)."""
        quantiles: Array = kernel_quantiles.weighted_quantiles(values, weights, levels, _BINS)
        return quantiles

    def gather(self, rows: Array, index: Indices) -> Array:
        """Columns `index` of `rows` (m, N)."""
        out = np.empty((len(rows), len(index)))
        kernels.gather(rows, index, out)
        return out

    def quantiles(self, mixture: Mixture, levels: Array, output: int) -> Array:
        """Quantiles (L,) of one output of a mixture."""
        quantiles: Array = kernel_quantiles.mixture_quantiles(
            levels, ndtri(levels), mixture.weights, mixture.means[output], mixture.sds[output]
        )
        return quantiles
