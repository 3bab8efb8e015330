"""The Rao-Blackwellized particle filter with stochastic volatility and gated learning (paper 3.4, Algorithm 1).

Algorithm 1 in predict-ahead form, its loop cut at another place: `update` scores and assimilates y_k, sets the gate,
resamples and rejuvenates (lines 11-15); `predict` propagates volatility and state to k + 1 (lines 8-9); `predictive` is
the mixture of line 10. The state between two samples is therefore the predicted one, and what it
forecasts is what the next update scores. Every method is pure.
"""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array, Indices
from estimator.kernels.draws import Draws, Purpose
from estimator.kernels.packing import packed
from estimator.network.assembly import assemble, topology
from estimator.network.discretise import heat_loss, time_constants
from estimator.network.network import Network
from estimator.network.space import parameter_space
from estimator.network.starting import initial_temperatures
from estimator.particle.compiled import CompiledSteps
from estimator.particle.gate import learning_gates, regime, weighted_quantiles
from estimator.particle.kalman import unpack
from estimator.particle.liu_west import liu_west_kernel
from estimator.particle.options import ALL_NODES, Options
from estimator.particle.reference import ReferenceSteps
from estimator.particle.resampling import Weighted, effective_sample_size, reweigh, systematic
from estimator.types import (
    ALPHA_LEVELS,
    LOG_SMALLEST,
    Mixture,
    Mixtures,
    ModelDraws,
    OneState,
    Outcome,
    ParameterSummary,
    Posterior,
    mixture_moments,
)

_ALPHA_LEVELS = np.array(ALPHA_LEVELS)


class ParticleState(NamedTuple):
    """N particles of a network with n_x states and d free parameters, B volatility blocks."""

    seed: Array
    """(): the zone's seed, uint64."""
    step: Array
    """(): k, int64; with `seed` it is the whole state of the random numbers."""
    coordinates: Array
    """(d, N): parameters, in the coordinates of the parameter space."""
    log_alpha: Array
    """(B, N)."""
    mean: Array
    """(n_x, N): state means [degC]."""
    covariance: Array
    """(n_x (n_x + 1) / 2, N): packed lower triangles [K^2]."""
    log_weights: Array
    """(N,): normalised."""
    histogram: Array
    """(B, n_bins): counts of the median of log alpha."""


class RBPF(OneState):
    """The filter of one zone. See `estimator.types.Estimator` for the moves."""

    state_type = ParticleState

    def __init__(self, network: Network, period: float, options: Options) -> None:
        self.network = network.validate()
        self.period = period
        self.options = options
        self.forecast_draws = options.particles
        self._topology = topology(network)
        self._space = parameter_space(network, logit=options.coordinates == "logit")
        blocks = options.volatility_blocks or {ALL_NODES: network.nodes}
        self.blocks = tuple(blocks)
        owner = {node: index for index, nodes in enumerate(blocks.values()) for node in nodes}
        block = np.array([owner[node] for node in network.nodes], dtype=np.int64)
        self._block = block
        steps = CompiledSteps if options.implementation == "compiled" else ReferenceSteps
        self._steps: CompiledSteps | ReferenceSteps = steps(network, self._space, period, block, options.process_sd)

    def start(self, seed: int, outputs: Array, inputs: Array) -> ParticleState:
        """Particles from the prior (lines 1-6), at the first sample: its outputs (n_y,) and inputs (n_u,)."""
        options, draws = self.options, Draws(seed, 0)
        count = options.particles
        place = draws.uniforms(Purpose.PRIOR_PARAMETERS, (len(self._space.free), count))
        log_alpha = options.alpha_initial_sd * draws.normals(Purpose.PRIOR_VOLATILITY, (len(self.blocks), count))
        mean, covariance = self._initial_temperatures(outputs, inputs, count)
        return ParticleState(
            seed=np.array(seed, dtype=np.uint64),
            step=np.array(0, dtype=np.int64),
            coordinates=self._space.from_uniform(place),
            log_alpha=np.clip(log_alpha, np.log(options.alpha_min), np.log(options.alpha_max)),
            mean=mean,
            covariance=covariance,
            log_weights=np.full(count, -np.log(count)),
            histogram=np.full((len(self.blocks), options.histogram_bins), options.histogram_pseudo_count),
        )

    def restart(self, state: ParticleState, outputs: Array, inputs: Array) -> ParticleState:
        """The first sample after a gap: thermal states wide again; parameters, volatility and weights kept."""
        mean, covariance = self._initial_temperatures(outputs, inputs, state.mean.shape[1])
        return state._replace(mean=mean, covariance=covariance)

    def predict(self, state: ParticleState, inputs: Array) -> ParticleState:
        """One period on under `inputs` (n_u,) held over the step (lines 8-9)."""
        step = int(state.step) + 1
        return self._propagate(state, inputs, step, Draws(int(state.seed), step))

    def predictive(self, state: ParticleState) -> Mixture:
        """The mixture of line 10, over every output."""
        measured = self._topology.measured
        variances = state.covariance[[packed(node, node) for node in measured]] + self.options.measurement_sd**2
        return Mixture(np.exp(state.log_weights), state.mean[measured], np.sqrt(variances))

    def update(self, state: ParticleState, outputs: Array) -> Posterior:
        """Lines 11-15 with y_k = `outputs` (n_y,); NaN marks a missing output."""
        if np.isnan(outputs).all():
            return self._kept(state, Outcome.MISSING)
        mean, covariance, log_weights = state.mean, state.covariance, state.log_weights
        for node, y in zip(self._topology.measured, outputs, strict=True):
            if not np.isnan(y):
                step = self._steps.assimilate(mean, covariance, node, y, self.options.measurement_sd**2)
                mean, covariance, log_weights = step.mean, step.covariance, log_weights + step.log_likelihood
        # A largest weight that is not a number is no reason to stop: the others may still explain the sample.
        if not np.fmax.reduce(log_weights) > LOG_SMALLEST:
            return self._kept(state, Outcome.VANISHED)
        return self._learn(state._replace(mean=mean, covariance=covariance), reweigh(log_weights))

    def parameters(self, state: ParticleState, levels: Array) -> ParameterSummary:
        """Weighted quantiles over particles of theta, the time constants and the heat-loss coefficient."""
        weights = np.exp(state.log_weights)
        theta = self._space.parameters(state.coordinates)
        matrices = assemble(self.network, theta)
        constants = time_constants(matrices).T
        losses = heat_loss(matrices, int(self._topology.measured[0]))
        return ParameterSummary(
            levels=levels,
            parameters=np.array([weighted_quantiles(row, weights, levels) for row in theta]),
            time_constants=np.array([weighted_quantiles(row, weights, levels) for row in constants]),
            heat_loss=weighted_quantiles(losses, weights, levels),
        )

    def issue(self, state: ParticleState, count: int) -> ParticleState:
        """At most `count` particles that stand for all, at even steps of the cumulated weights."""
        if len(state.log_weights) <= count:
            return state
        cumulated = np.cumsum(np.exp(state.log_weights))
        places = (np.arange(count) + 0.5) / count * cumulated[-1]
        index = np.minimum(np.searchsorted(cumulated, places), len(cumulated) - 1)
        return _chosen(state, index)._replace(log_weights=np.full(count, -np.log(count)))

    def unfold(self, issue: ParticleState, plan: Array) -> Mixtures:
        """The outputs at the issue's time and after each row of `plan` (h, n_u), each particle along a volatility path
        of its own."""
        measured = self._topology.measured
        means = np.empty((len(plan) + 1, len(measured), len(issue.log_weights)))
        variances = np.empty_like(means)
        means[0], variances[0] = issue.mean[measured], issue.covariance[[packed(i, i) for i in measured]]
        now = Draws(int(issue.seed), int(issue.step), forecast=True)
        self._steps.outputs_ahead(
            issue.coordinates, issue.mean, issue.covariance, issue.log_alpha, plan, self.options, now, measured,
            means[1:], variances[1:],
        )  # fmt: skip
        variances += self.options.measurement_sd**2
        weights = np.broadcast_to(np.exp(issue.log_weights), (len(means), means.shape[2]))
        return Mixtures(weights, means, np.sqrt(variances, out=variances))

    def draws(self, state: ParticleState, count: int) -> ModelDraws:
        """At most `count` particles that stand for all, each with the mean of its temperatures."""
        size = len(state.mean)
        weights, covariances = np.exp(state.log_weights), unpack(state.covariance)
        phi = self._steps.mean_log_parameters(state.coordinates, weights)
        few = self.issue(state, count)
        shares = np.exp(few.log_weights)
        variances = few.covariance[[packed(i, i) for i in range(size)]]
        noise = (np.exp(few.log_alpha[self._block]) * self.options.process_sd) ** 2
        mean, covariance = mixture_moments(weights, state.mean, covariances)
        return ModelDraws(
            network=self.network,
            point=self._space.from_logs(phi),
            mean=mean,
            covariance=covariance,
            weights=shares / shares.sum(),
            theta=self._space.parameters(few.coordinates),
            state=few.mean,
            spread=np.sqrt(np.maximum(variances, 0.0)),
            gain_decay=np.empty((0, len(shares))),
            gain_stays=1.0,
            process_variance=noise,
            measurement_variance=np.full((len(self.network.measured), len(shares)), self.options.measurement_sd**2),
        )

    def _initial_temperatures(self, outputs: Array, inputs: Array, count: int) -> tuple[Array, Array]:
        """Means (n_x, N) and packed covariances of all particles at a first sample."""
        start, sds = initial_temperatures(self.network, outputs, inputs)
        size = len(start)
        mean = np.tile(start[:, None], count)
        covariance = np.zeros((size * (size + 1) // 2, count))
        for i, sd in enumerate(sds):
            covariance[packed(i, i)] = sd**2
        return mean, covariance

    def _propagate(self, state: ParticleState, inputs: Array, step: int, draws: Draws) -> ParticleState:
        log_alpha = self._steps.walk(state.log_alpha, self.options, draws)
        mean, covariance = self._steps.propagate(state.coordinates, state.mean, state.covariance, log_alpha, inputs)
        return state._replace(
            step=np.array(step, dtype=np.int64), log_alpha=log_alpha, mean=mean, covariance=covariance
        )

    def _learn(self, state: ParticleState, weighted: Weighted) -> Posterior:
        """Gate, resample, rejuvenate (lines 13-15) with the new weights."""
        options, weights, log_weights = self.options, weighted.weights, weighted.log_weights
        draws = Draws(int(state.seed), int(state.step))
        phi = self._steps.mean_log_parameters(state.coordinates, weights)
        quantiles = np.array([weighted_quantiles(row, weights, _ALPHA_LEVELS) for row in state.log_alpha])
        gates = learning_gates(state.histogram, quantiles[:, 1], options)
        gate = min(block.gate for block in gates)
        resampled = weighted.effective_sample_size < options.resample_below * options.particles
        if resampled:
            index = systematic(weights, float(draws.uniforms(Purpose.RESAMPLE, (1, 1))[0, 0]))
            weights = np.full(len(weights), 1.0 / len(weights))
            log_weights = np.full(len(weights), -np.log(len(weights)))
            state = _chosen(state, index)
        kernel = liu_west_kernel(*self._steps.moments(state.coordinates, weights), gate, options)
        state = state._replace(
            coordinates=self._steps.rejuvenate(state.coordinates, kernel, draws),
            log_weights=log_weights,
            histogram=np.array([block.histogram for block in gates]),
        )
        return Posterior(
            state=state,
            outcome=Outcome.ASSIMILATED,
            log_likelihood=weighted.log_sum,
            alpha_quantiles=np.exp(quantiles),
            cdf=np.array([block.cdf for block in gates]),
            gate=gate,
            regime=regime(max(block.cdf for block in gates), options),
            effective_sample_size=weighted.effective_sample_size,
            resampled=resampled,
            floored=kernel.floored,
            parameters=self._space.from_logs(phi),
        )

    def _kept(self, state: ParticleState, outcome: Outcome) -> Posterior:
        """The summary of a step that learned nothing: the prior is kept, the gate is shut."""
        weights = np.exp(state.log_weights)
        quantiles = np.array([weighted_quantiles(row, weights, _ALPHA_LEVELS) for row in state.log_alpha])
        counted = [block.cdf for block in learning_gates(state.histogram, quantiles[:, 1], self.options)]
        return Posterior(
            state=state,
            outcome=outcome,
            log_likelihood=float("nan"),
            alpha_quantiles=np.exp(quantiles),
            cdf=np.array(counted),
            gate=0.0,
            regime=regime(max(counted), self.options),
            effective_sample_size=effective_sample_size(weights),
            parameters=self._space.from_logs(self._steps.mean_log_parameters(state.coordinates, weights)),
        )


def _chosen(state: ParticleState, index: Indices) -> ParticleState:
    """`state` with the particles `index` (K,); weights as they were."""
    # `take` keeps rows contiguous, which the kernels count on; indexing would not.
    coordinates, log_alpha, mean, covariance = (rows.take(index, axis=1) for rows in state[2:6])
    return state._replace(coordinates=coordinates, log_alpha=log_alpha, mean=mean, covariance=covariance)
