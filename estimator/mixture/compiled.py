"""The moves of `ReferenceMixture` that cost most, on the Numba kernels."""

import numpy as np

from estimator.arrays import Array, Indices
from estimator.kernels.draws import Draws, Purpose
from estimator.mixture import kernels, scenarios
from estimator.mixture.kernels import Settings, Shape
from estimator.mixture.model import MixtureModel, Particles, Scenarios, Walk
from estimator.mixture.reference import ReferenceMixture


class CompiledMixture(ReferenceMixture):
    """One network's moves, compiled; arrays as in `ReferenceMixture`."""

    def __init__(self, model: MixtureModel) -> None:
        super().__init__(model)
        space = model.space
        # The kernels are compiled for each number of states: the type of this tuple.
        self._size = (0,) * model.states
        slot = np.full(len(space.fixed), -1, dtype=np.int64)
        slot[space.free] = np.arange(len(space.free))
        self._shape = Shape(
            slot, space.free, space.fixed, model.lower, model.upper, model.prior_variance,
            model.heated, model.term_place, model.coefficient_walk, model.block,
        )  # fmt: skip
        self._settings = _settings(model)

    def propagate(self, particles: Particles, walk: Walk, inputs: Array, gate: float) -> tuple[Particles, Array]:
        """One period on under `inputs` (n_u + m,), and the logarithms (N,) of what each proposal is worth."""
        new = Particles(*map(np.empty_like, particles))
        worth = np.empty(particles.mean.shape[1])
        kernels.propagate(
            self._size, self._model.topology, self._shape, self._settings, gate, np.asarray(inputs, dtype=np.float64),
            walk.normals, walk.uniforms, particles, new, worth,
        )  # fmt: skip
        return new, worth

    def assimilate(self, particles: Particles, outputs: Array) -> tuple[Particles, Array]:
        """Kalman update by `outputs` (n_y,), NaN for a missing one, and log likelihoods (N,)."""
        mean, covariance = np.empty_like(particles.mean), np.empty_like(particles.covariance)
        log_likelihood = np.empty(mean.shape[1])
        kernels.assimilate(
            self._model.topology.measured, self._shape, self._model.news, outputs, particles,
            mean, covariance, log_likelihood,
        )  # fmt: skip
        return Particles(mean, covariance, *particles[2:]), log_likelihood

    def sample(self, particles: Particles, index: Indices, normals: Array) -> Array:
        """Draws z (n_z, K) from the Gaussians of the particles `index` (K,)."""
        out = np.empty_like(normals)
        scenarios.sample(self._shape, particles.mean, particles.covariance, index, normals, out)
        return out

    def paths(self, start: Scenarios, plan: Array) -> Array:
        """Temperatures (h, n_y, K) of the measured nodes after each row of `plan` (h, n_u + m)."""
        draws = Draws(int(start.seed), int(start.step), forecast=True)
        out = np.empty((len(plan), self._model.outputs, start.state.shape[1]))
        scenarios.paths(
            self._size, self._model.topology, self._shape, self._settings, draws.seed, draws.step,
            draws.stream(Purpose.SCENARIO), draws.stream(Purpose.SCENARIO_SWITCH),
            np.ascontiguousarray(plan, dtype=np.float64), start, out,
        )  # fmt: skip
        return out


def _settings(model: MixtureModel) -> Settings:
    options = model.options
    return Settings(
        period=model.period,
        gain_node=model.gain_node if model.gains else -1,
        process_variance=options.process_sd**2,
        volatile_process=options.volatility == "process",
        volatile_gain=options.volatility == "gain",
        volatility_sd=options.volatility_sd,
        jump_probability=options.jump_probability,
        jump_sd=options.jump_sd,
        alpha_low=float(np.log(options.alpha_min)),
        alpha_high=float(np.log(options.alpha_max)),
        noise_walk=options.hyper_walk_sd if model.learns_noise else 0.0,
        noise_low=model.noise_bounds[0],
        noise_high=model.noise_bounds[1],
        on_probability=model.on_probability,
        proposed_on_probability=model.proposed_on_probability,
        off_probability=model.off_probability,
        spread_low=model.gain_sd_bounds[0],
        spread_high=model.gain_sd_bounds[1],
        decays=options.gain_decays,
        hour_walk=options.hyper_walk_sd,
        hour_low=model.hour_bounds[0],
        hour_high=model.hour_bounds[1],
        gain_walk=options.gain_walk_sd,
        parameter_variance=options.parameter_sd**2,
    )
