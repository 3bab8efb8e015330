"""The same Kalman step of every particle by other means: a filterpy loop, and JAX over all particles at once.

Each takes the network's matrices of every particle, discretises them exactly (zero-order hold by the matrix exponential
of the augmented matrix), predicts, and assimilates one output, in float64. That is the core of an update, not all of
it: no volatility, quantiles, gate or rejuvenation. The project's own line is its prediction, volatility included, and
measurement update alone, from the same particles.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.network.assembly import assemble
from estimator.network.presets import building_67
from estimator.network.space import parameter_space
from estimator.particle.rbpf import RBPF
from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.bench.workload import build, pin_to_one_processor, samples, settled, spread, timed
from replay.simulated.semi_synthetic import PERIOD


class Problem:
    """The particles of a settled filter as matrices: generators (N, n + n_u, n + n_u), means, covariances, noise."""

    def __init__(self, sizes: Sizes) -> None:
        self.filter: RBPF = build(sizes.particles)
        given = samples()
        self.state = settled(self.filter, given, sizes.settle)
        (self.y,), self.inputs = given.at(sizes.settle)
        network, options = building_67(), self.filter.options
        space = parameter_space(network, logit=options.coordinates == "logit")
        matrices = assemble(network, space.parameters(self.state.coordinates))
        count, n, width = matrices.inputs.shape
        self.generators = np.zeros((count, n + width, n + width))
        self.generators[:, :n, :n] = -matrices.internal / matrices.capacitance[:, :, None]
        self.generators[:, :n, n:] = matrices.inputs / matrices.capacitance[:, :, None]
        self.means = np.ascontiguousarray(self.state.mean.T)
        self.covariances = np.zeros((count, n, n))
        rows, columns = np.tril_indices(n)
        self.covariances[:, rows, columns] = self.covariances[:, columns, rows] = self.state.covariance.T
        alpha = np.exp(self.state.log_alpha[0])
        self.noise = (alpha * options.process_sd) ** 2
        self.variance = options.measurement_sd**2
        self.nodes = n


def comparisons(sizes: Sizes) -> Mapping[str, Any]:
    """Seconds per particle of each, on one processor; what is not installed is left out with the reason."""
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    pin_to_one_processor()
    problem = Problem(sizes)
    means = _own(problem, sizes)
    found: dict[str, Any] = {"particles": sizes.particles, "thermogate": means}
    for name, measure in {"filterpy": _filterpy, "jax": _jax, "cuthbert": _cuthbert}.items():
        try:
            found[name] = measure(problem, sizes)
        except ImportError as error:
            found[name] = {"skipped": f"not installed ({error.name}); install the extra 'bench'"}
            continue
        found[name]["ratio"] = found[name]["per_particle_s"] / means["per_particle_s"]
    return found


def _own(problem: Problem, sizes: Sizes) -> dict[str, Any]:
    """The filter's own prediction, which also takes the volatility a step on, and its measurement update."""
    estimator, state, node = problem.filter, problem.state, problem.filter.network.nodes.index("T_i")

    def step() -> Array:
        ahead = estimator.predict(state, problem.inputs)
        y, variance = float(problem.y), problem.variance
        return np.asarray(estimator._steps.assimilate(ahead.mean, ahead.covariance, node, y, variance).mean[node])

    return _measured(step, sizes.particles, sizes.growth_repeats)


def _filterpy(problem: Problem, sizes: Sizes) -> dict[str, Any]:
    from filterpy.kalman import KalmanFilter
    from scipy.linalg import expm

    n, width = problem.nodes, len(problem.inputs)
    count = min(sizes.filterpy_particles, sizes.particles)

    def step() -> Array:
        indoor = np.empty(count)
        for particle in range(count):
            transition = expm(problem.generators[particle] * PERIOD)[:n]
            kalman = KalmanFilter(dim_x=n, dim_z=1, dim_u=width)
            kalman.x, kalman.P = problem.means[particle][:, None], problem.covariances[particle]
            kalman.F, kalman.B = transition[:, :n], transition[:, n:]
            kalman.Q, kalman.R = problem.noise[particle] * np.eye(n), np.array([[problem.variance]])
            kalman.H = np.eye(1, n)
            kalman.predict(u=problem.inputs[:, None])
            kalman.update(problem.y)
            indoor[particle] = kalman.x[0, 0]
        return indoor

    return _measured(step, count, 3)


def _jax(problem: Problem, sizes: Sizes) -> dict[str, Any]:
    import jax
    import jax.numpy as jnp
    from jax.scipy.linalg import expm

    jax.config.update("jax_enable_x64", True)
    n = problem.nodes
    inputs, identity = jnp.asarray(problem.inputs), jnp.eye(n)

    def one(generator: Any, mean: Any, covariance: Any, noise: Any) -> tuple[Any, Any, Any]:
        transition = expm(generator * PERIOD)[:n]
        mean = transition[:, :n] @ mean + transition[:, n:] @ inputs
        covariance = transition[:, :n] @ covariance @ transition[:, :n].T + noise * identity
        total, innovation = covariance[0, 0] + problem.variance, problem.y - mean[0]
        gain = covariance[:, 0] / total
        density = -0.5 * (innovation**2 / total + jnp.log(2 * jnp.pi * total))
        return mean + gain * innovation, covariance - jnp.outer(gain, covariance[0]), density

    step = jax.jit(jax.vmap(one))
    arrays = tuple(map(jnp.asarray, (problem.generators, problem.means, problem.covariances, problem.noise)))
    return _measured(lambda: np.asarray(step(*arrays)[0])[:, 0], sizes.particles, sizes.growth_repeats) | {
        "version": jax.__version__
    }


def _cuthbert(problem: Problem, sizes: Sizes) -> dict[str, Any]:
    import jax
    import jax.numpy as jnp
    from cuthbertlib.kalman.filtering import predict, update
    from jax.scipy.linalg import expm

    jax.config.update("jax_enable_x64", True)
    n = problem.nodes
    inputs, seen = jnp.asarray(problem.inputs), jnp.eye(1, n)
    sd, measured = jnp.full((1, 1), problem.variance**0.5), jnp.asarray([problem.y])

    def one(generator: Any, mean: Any, root: Any, noise: Any) -> tuple[Any, Any]:
        transition = expm(generator * PERIOD)[:n]
        shift = transition[:, n:] @ inputs
        mean, root = predict(mean, root, transition[:, :n], shift, jnp.sqrt(noise) * jnp.eye(n))
        (mean, root), density = update(mean, root, seen, jnp.zeros(1), sd, measured)
        return mean, density

    step = jax.jit(jax.vmap(one))
    roots = np.linalg.cholesky(problem.covariances)
    arrays = tuple(map(jnp.asarray, (problem.generators, problem.means, roots, problem.noise)))
    return _measured(lambda: np.asarray(step(*arrays)[0])[:, 0], sizes.particles, sizes.growth_repeats)


def _measured(step: Callable[[], Array], particles: int, repeats: int) -> dict[str, Any]:
    """Time `step`, which returns the measured node's mean of every particle it handled, after a first call."""
    indoor = step()
    seconds = spread([timed(step)[0] for _ in range(repeats)])
    return seconds | {
        "particles": particles,
        "per_particle_s": seconds["median_s"] / particles,
        "mean_indoor_degC_of_first": float(indoor[0]),
    }
