"""The mixture Kalman filter: parameters, temperatures and unmeasured heat in one Gaussian per particle.

Chen and Liu, "Mixture Kalman filters", J. R. Statist. Soc. B 62 (2000). A particle samples only what makes the model
nonlinear: volatility, measurement noise, whether an unmeasured heat gain is on, and its time constant. Everything else
is in its Gaussian over z = [x, q, c, phi], moved by an extended Kalman filter with exact zero-order hold and
derivatives. A few hundred particles therefore do, and parameters cannot all descend from one lucky ancestor.

As in `estimator.rbpf`, the state between two samples is the predicted one, and every method is pure.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from estimator.arrays import HOUR, Array, Indices
from estimator.kernels.draws import Draws, Purpose
from estimator.kernels.packing import packed
from estimator.mixture.compiled import CompiledMixture
from estimator.mixture.model import WATTS, MixtureModel, Particles, Scenarios, Walk
from estimator.mixture.options import MKFOptions
from estimator.mixture.reference import ReferenceMixture
from estimator.network.assembly import assemble
from estimator.network.discretise import heat_loss, time_constants
from estimator.network.network import Network
from estimator.network.starting import initial_temperatures
from estimator.particle.gate import learning_gates, regime, weighted_quantiles
from estimator.particle.kalman import unpack
from estimator.particle.resampling import Weighted, effective_sample_size, reweigh, systematic
from estimator.types import (
    ALPHA_LEVELS,
    LOG_SMALLEST,
    Disturbance,
    Mixture,
    Mixtures,
    ModelDraws,
    OneState,
    Outcome,
    ParameterSummary,
    Posterior,
    mixture_moments,
)

_SUMMARY_DRAWS = 400
"""Draws of phi for the quantiles of parameters and of what follows from them."""

_NEGLIGIBLE = 1e-4
"""Share of an average weight below which a particle that will never change its mind is dropped."""

_OFF_SD = 1e-9
"""Standard deviation [kW] that stands for none."""

LEVELS = np.array(ALPHA_LEVELS)


class MKFState(NamedTuple):
    """N particles; n_z, B, G and n_y as in `Particles`."""

    seed: Array
    """(): the zone's seed, uint64."""
    step: Array
    """(): k, int64; with `seed` it is the whole state of the random numbers."""
    mean: Array
    covariance: Array
    log_alpha: Array
    log_noise: Array
    gain_on: Array
    log_hours: Array
    """As in `Particles`."""
    log_weights: Array
    """(N,): normalised."""
    histogram: Array
    """(B, n_bins): counts of the median of log alpha."""
    gate: Array
    """(): g_k, by which the random walk of phi is scaled."""

    def particles(self) -> Particles:
        """The particles without their weights."""
        return Particles(*self[2:8])

    def with_particles(self, particles: Particles) -> MKFState:
        """With other particles."""
        return MKFState(*self[:2], *particles, *self[8:])


class MKF(OneState):
    """The filter of one zone. See `estimator.types.Estimator` for the methods.

    The learning gate comes from the history of alpha as in the paper (3.4.4); here it scales the random walk of the
    log parameters. Without volatility it is 1.
    """

    state_type = MKFState

    def __init__(self, network: Network, period: float, options: MKFOptions) -> None:
        """`network` at a sampling `period` [s]; NetworkError for a network that is not sound."""
        self.network = network.validate()
        self.period = period
        self.options = options
        self.forecast_draws = options.scenarios
        self._model = MixtureModel(network, period, options)
        self.blocks = self._model.blocks
        moves = CompiledMixture if options.implementation == "compiled" else ReferenceMixture
        self._moves: CompiledMixture | ReferenceMixture = moves(self._model)

    @property
    def issue_type(self) -> type[Scenarios]:
        """Starts of sampled futures."""
        return Scenarios

    def start(self, seed: int, outputs: Array, inputs: Array) -> MKFState:
        """Particles from the prior at the first sample: its outputs (n_y,) and inputs (n_u,).

        The centres of phi are draws from the prior, drawn together so that, with the spread of each particle's own
        Gaussian, the mixture has the variance of the prior.
        """
        model, options, draws = self._model, self.options, Draws(seed, 0)
        count = options.particles
        place = draws.uniforms(Purpose.PRIOR_PARAMETERS, (model.free, count))
        log_alpha = options.alpha_initial_sd * draws.normals(Purpose.PRIOR_VOLATILITY, (len(self.blocks), count))
        noise = draws.uniforms(Purpose.PRIOR_NOISE, (model.outputs, count))
        on, size, hours = np.split(draws.uniforms(Purpose.PRIOR_GAIN, (3 * model.gains, count)), 3)
        gain_on = np.where(on < self._initially_on(), 1.0, 0.0)
        mean, covariance = np.zeros((model.size, count)), np.zeros((model.size * (model.size + 1) // 2, count))
        mean[model.coefficients] = model.coefficient_mean[:, None]
        mean[model.size - model.free :] = model.space.from_uniform(place, np.sqrt(1.0 - options.start_share**2))
        for d, variance in enumerate(model.prior_variance, model.size - len(model.prior_variance)):
            covariance[packed(d, d)] = variance if d < model.size - model.free else options.start_share**2 * variance
        for i in range(model.states, model.states + model.gains):
            covariance[packed(i, i)] = (gain_on * np.exp(2.0 * _between(size, model.gain_sd_bounds)))[0]
        self._set_temperatures(mean, covariance, outputs, inputs)
        return MKFState(
            seed=np.array(seed, dtype=np.uint64),
            step=np.array(0, dtype=np.int64),
            mean=mean,
            covariance=covariance,
            log_alpha=np.clip(log_alpha, np.log(options.alpha_min), np.log(options.alpha_max)),
            log_noise=_between(noise, model.noise_bounds),
            gain_on=gain_on,
            log_hours=_between(hours, model.hour_bounds),
            log_weights=np.full(count, -np.log(count)),
            histogram=np.full((len(self.blocks), options.histogram_bins), options.histogram_pseudo_count),
            gate=np.array(1.0),
        )

    def restart(self, state: MKFState, outputs: Array, inputs: Array) -> MKFState:
        """The first sample after a gap: temperatures wide again; parameters, gain, noise and weights kept."""
        mean, covariance = state.mean.copy(), state.covariance.copy()
        self._set_temperatures(mean, covariance, outputs, inputs)
        return state._replace(mean=mean, covariance=covariance)

    def predict(self, state: MKFState, inputs: Array) -> MKFState:
        """One period on under `inputs` (n_u,) held over the step."""
        step, count = int(state.step) + 1, state.mean.shape[1]
        draws, (normals, uniforms) = Draws(int(state.seed), step), self._model.walk_shapes
        walk = Walk(
            draws.normals(Purpose.MIXTURE_WALK, (normals, count)),
            draws.uniforms(Purpose.MIXTURE_SWITCH, (uniforms, count)),
        )
        particles, worth = self._moves.propagate(state.particles(), walk, inputs, float(state.gate))
        log_weights = state.log_weights
        if self._model.proposed_on_probability > self._model.on_probability:
            log_weights = reweigh(log_weights + worth).log_weights
        return MKFState(state.seed, np.array(step), *particles, log_weights, state.histogram, state.gate)

    def predictive(self, state: MKFState) -> Mixture:
        """The mixture over every output, measurement noise included."""
        measured = self._model.topology.measured
        variances = state.covariance[measured * (measured + 3) // 2] + np.exp(2.0 * state.log_noise)
        return Mixture(np.exp(state.log_weights), state.mean[measured], np.sqrt(variances))

    def update(self, state: MKFState, outputs: Array) -> Posterior:
        """Kalman update and weight of every particle by `outputs` (n_y,), NaN for a missing one; gate; resampling."""
        if np.isnan(outputs).all():
            return self._kept(state, Outcome.MISSING)
        particles, log_likelihood = self._moves.assimilate(state.particles(), outputs)
        log_weights = state.log_weights + log_likelihood
        # A largest weight that is not a number is no reason to stop: the others may still explain the sample.
        if not np.fmax.reduce(log_weights) > LOG_SMALLEST:
            return self._kept(state, Outcome.VANISHED)
        return self._learn(state.with_particles(particles), reweigh(log_weights))

    def scenarios(self, state: MKFState, plan: Array, count: int) -> Array:
        """Sampled futures (`count`, h + 1, n_y) of the measured nodes [degC], without measurement noise.

        The first is at the state's time, the others after each row of `plan` (h, n_u). All are equally likely; each
        has its own parameters, temperatures and gain, and its own process noise, volatility and switching. A
        stochastic controller plans over them. Asking changes nothing in what the filter will draw.
        """
        start = self.issue(state, count)
        later = self._moves.paths(start, plan)
        return np.concatenate([start.state[None, self._model.topology.measured], later]).transpose(2, 0, 1)

    def issue(self, state: MKFState, count: int) -> Scenarios:
        """Starts of `count` sampled futures from `state`."""
        # Streams of their own: asking for a forecast changes nothing in what the filter will draw.
        draws = Draws(int(state.seed), int(state.step), forecast=True)
        index, z = self._sample(state, draws, count)
        chosen = (np.take(rows, index, axis=1) for rows in state.particles()[2:])
        return Scenarios(state.seed, state.step, z, *chosen)

    def unfold(self, issue: Scenarios, plan: Array) -> Mixtures:
        """What the issue forecasts, at its state's time and then after each row of `plan` (h, n_u)."""
        count = issue.state.shape[1]
        means = np.concatenate([issue.state[None, self._model.topology.measured], self._moves.paths(issue, plan)])
        sds = np.empty_like(means)
        sds[:] = np.exp(issue.log_noise)
        return Mixtures(np.full((len(means), count), 1.0 / count), means, sds)

    def draws(self, state: MKFState, count: int) -> ModelDraws:
        """`count` draws from the mixture: the starts of sampled futures."""
        model, options = self._model, self.options
        rows, gains = model.states + model.gains, slice(model.states, model.states + model.gains)
        watts = np.concatenate([np.ones(model.states), np.full(model.gains, WATTS)])
        weights, covariances = np.exp(state.log_weights), unpack(state.covariance[: packed(rows, 0)])
        mean, covariance = mixture_moments(weights, state.mean[:rows], covariances)
        start = self.issue(state, count)
        alpha, variance = np.exp(start.log_alpha), np.full((rows, count), options.process_sd**2)
        if options.volatility == "process":
            variance[: model.states] *= alpha[model.block] ** 2
        walk = options.gain_walk_sd * (alpha[0] if options.volatility == "gain" else 1.0)
        variance[gains] = start.gain_on * (WATTS * walk) ** 2
        decay = np.ones_like(start.log_hours)
        if options.gain_decays:
            decay = np.exp(-model.period / (HOUR * np.exp(start.log_hours)))
        at = start.state[:rows] * watts[:, None]
        at[gains] *= start.gain_on
        return ModelDraws(
            network=self.network,
            point=self._summary(state, weights).parameters,
            mean=mean * watts,
            covariance=covariance * np.outer(watts, watts),
            weights=np.full(count, 1.0 / count),
            theta=model.space.parameters(start.state[model.size - model.free :]),
            state=at,
            spread=np.zeros((rows, count)),
            gain_decay=decay,
            gain_stays=1.0 - model.off_probability,
            process_variance=variance,
            measurement_variance=np.exp(2.0 * start.log_noise),
            coefficients=start.state[model.coefficients],
        )

    def parameters(self, state: MKFState, levels: Array) -> ParameterSummary:
        """Quantiles of theta, time constants and heat loss over draws of phi from the mixture.

        The draws belong to the state: equal states have equal quantiles.
        """
        z = self._sample(state, Draws(int(state.seed), int(state.step)), _SUMMARY_DRAWS)[1]
        theta = self._model.space.parameters(z[self._model.size - self._model.free :])
        matrices = assemble(self.network, theta)
        return ParameterSummary(
            levels=levels,
            parameters=np.quantile(theta, levels, axis=1).T,
            time_constants=np.quantile(time_constants(matrices), levels, axis=0).T,
            heat_loss=np.quantile(heat_loss(matrices, self._model.gain_node), levels),
            coefficients=np.quantile(z[self._model.coefficients], levels, axis=1).T,
        )

    def _initially_on(self) -> float:
        """Probability that a gain is on at the start: that of the switching in the long run."""
        options = self.options
        if options.gain == "always":
            return 1.0
        ends = options.gain_off_probability
        return options.gain_on_probability / max(options.gain_on_probability + ends, np.finfo(float).tiny)

    def _set_temperatures(self, mean: Array, covariance: Array, outputs: Array, inputs: Array) -> None:
        """Write the temperatures of a first sample into means and packed covariances, uncorrelated with the rest."""
        start, sds = initial_temperatures(self.network, outputs, inputs)
        states = self._model.states
        mean[:states] = start[:, None]
        for i in range(self._model.size):
            for j in range(min(i + 1, states)):
                covariance[packed(i, j)] = sds[i] ** 2 if i == j else 0.0

    def _sample(self, state: MKFState, draws: Draws, count: int) -> tuple[Indices, Array]:
        """Indices (K,) of particles, drawn by weight, and draws (n_z, K) from their Gaussians."""
        place = float(draws.uniforms(Purpose.RESAMPLE, (1, 1))[0, 0])
        index = systematic(np.exp(state.log_weights), place, count)
        normals = draws.normals(Purpose.MIXTURE_SAMPLE, (self._model.size, count))
        return index, self._moves.sample(state.particles(), index, normals)

    def _learn(self, state: MKFState, weighted: Weighted) -> Posterior:
        """Gate and resampling with the new weights."""
        summary = self._summary(state, weighted.weights)
        gates = learning_gates(state.histogram, np.log(summary.alpha_quantiles[:, 1]), self.options)
        gate = min((block.gate for block in gates), default=1.0)
        histogram = np.array([block.histogram for block in gates]) if gates else state.histogram
        state = MKFState(*state[:8], weighted.log_weights, histogram, np.array(gate))
        state, resampled = self._resampled(state, weighted)
        return summary._replace(
            state=state,
            outcome=Outcome.ASSIMILATED,
            log_likelihood=weighted.log_sum,
            cdf=np.array([block.cdf for block in gates]),
            gate=gate if gates else None,
            regime=self._regime([block.cdf for block in gates]),
            effective_sample_size=weighted.effective_sample_size,
            resampled=resampled,
        )

    def _resampled(self, state: MKFState, weighted: Weighted) -> tuple[MKFState, bool]:
        """With the particles that go on, and whether they are others than before."""
        weights = weighted.weights
        if self._model.samples_nothing:
            # Copies of a particle would stay equal for ever: it keeps its weight, and those without any are dropped.
            counts = weights > _NEGLIGIBLE / len(weights)
            if counts.all():
                return state, False
            index = np.flatnonzero(counts)
            log_weights = state.log_weights[index] - np.log(weights[index].sum())
        elif weighted.effective_sample_size < self.options.resample_below * len(weights):
            draws = Draws(int(state.seed), int(state.step))
            place = float(draws.uniforms(Purpose.RESAMPLE, (1, 1))[0, 0])
            index = systematic(weights, place, len(weights))
            log_weights = np.full(len(weights), -np.log(len(weights)))
        else:
            return state, False
        chosen = Particles(*(rows.take(index, axis=1) for rows in state.particles()))
        return state.with_particles(chosen)._replace(log_weights=log_weights), True

    def _kept(self, state: MKFState, outcome: Outcome) -> Posterior:
        """The summary of a step that learned nothing: the prior is kept, the gate is shut."""
        weights = np.exp(state.log_weights)
        summary = self._summary(state, weights)
        gates = learning_gates(state.histogram, np.log(summary.alpha_quantiles[:, 1]), self.options)
        counted = [block.cdf for block in gates]
        return summary._replace(
            outcome=outcome,
            cdf=np.array(counted),
            regime=self._regime(counted),
            effective_sample_size=effective_sample_size(weights),
        )

    def _summary(self, state: MKFState, weights: Array) -> Posterior:
        """What `state` with `weights` (N,) knows; outcome, gate and the like are of a step that learned nothing."""
        phi = (state.mean[self._model.size - self._model.free :] * weights).sum(axis=1)
        alpha = [weighted_quantiles(row, weights, LEVELS) for row in state.log_alpha]
        return Posterior(
            state=state,
            outcome=Outcome.MISSING,
            log_likelihood=float("nan"),
            parameters=self._model.space.from_logs(phi),
            alpha_quantiles=np.exp(np.reshape(alpha, (-1, len(LEVELS)))),
            gate=0.0 if self.blocks else None,
            disturbance=partial(self._disturbance, state, weights),
        )

    def _disturbance(self, state: MKFState, weights: Array, drive: Array) -> Disturbance:
        noise = np.exp(np.array([weighted_quantiles(row, weights, LEVELS) for row in state.log_noise]))
        on = float((weights * state.gain_on[0]).sum()) if self._model.gains else float("nan")
        habits = self._model.habits
        if habits.any():
            gain = self._with_habits(state, weights, np.where(habits, drive[len(self.network.inputs) :], 0.0))
        else:
            gain = self._gain(state, weights, on)
        return Disturbance(gain, on, noise)

    def _with_habits(self, state: MKFState, weights: Array, known: Array) -> Array:
        """Quantiles (3,) [W] of the gain and the heat of habits together; the known part of the latter is `known` (m,)
        [W per unit]."""
        model = self._model
        active = np.flatnonzero(known)
        places = [*(model.coefficients.start + active).tolist(), *range(model.states, model.states + model.gains)]
        watts = np.concatenate([np.tile(known[active, None], len(weights)), WATTS * state.gain_on])
        means = (watts * state.mean[places]).sum(axis=0)
        covariances = state.covariance[[[packed(i, j) for j in places] for i in places]]
        variances = np.einsum("in,ijn,jn->n", watts, covariances, watts)
        sds = np.sqrt(np.maximum(variances, _OFF_SD**2))
        return Mixture(weights, means[None], sds[None]).quantiles(LEVELS, 0)

    def _gain(self, state: MKFState, weights: Array, on: float) -> Array:
        """Quantiles (3,) of the gain [W], which is `on` with this probability, and 0 for certain where it is off."""
        if not self._model.gains:
            return np.full(len(LEVELS), np.nan)
        shares = weights * state.gain_on[0]
        quantiles = np.zeros(len(LEVELS))
        if on > 0.0:
            at, there = self._model.states, np.flatnonzero(shares)
            variances, shares = state.covariance[packed(at, at), there], shares[there]
            means, sds = state.mean[at, there], np.sqrt(np.maximum(variances, _OFF_SD**2))
            below = float((shares * ndtr(-means / sds)).sum())
            begin, above = below > LEVELS, LEVELS - (1.0 - on)
            # The other levels fall on the share 1 - on of the mixture that stands at 0.
            elsewhere = begin | (above > below)
            if elsewhere.any():
                mixture = Mixture(shares / on, means[None], sds[None])
                levels = np.where(begin, LEVELS, above)[elsewhere] / on
                quantiles[elsewhere] = mixture.quantiles(levels, 0)
        return WATTS * quantiles

    def _regime(self, cdf: list[float]) -> str | None:
        return regime(max(cdf), self.options) if cdf else None


def _between(place: Array, bounds: tuple[float, float]) -> Array:
    """Places in [0, 1] stretched to `bounds`."""
    return bounds[0] + (bounds[1] - bounds[0]) * place
