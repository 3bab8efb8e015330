"""The moves of the mixture Kalman filter in NumPy: the oracle that the compiled kernels are held to.

Chen and Liu, "Mixture Kalman filters", J. R. Statist. Soc. B 62 (2000): what makes the model conditionally Gaussian is
sampled, the rest is an (extended) Kalman filter of each particle.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from estimator.arrays import HOUR, Array, Indices
from estimator.gaussian.floor import with_known_gain
from estimator.kernels.draws import Draws, Purpose
from estimator.kernels.packing import packed
from estimator.mixture.model import SMALLEST_PIVOT, WATTS, MixtureModel, Particles, Scenarios, Walk
from estimator.network.modal import ModalNetwork
from estimator.network.network import HeatInput
from estimator.particle.kalman import kalman_update, pack, unpack
from estimator.particle.volatility import walked_volatility

_GAIN_CHANNEL = "unmeasured gain"


class ReferenceMixture:
    """One network's moves, written as a textbook writes them."""

    def __init__(self, model: MixtureModel) -> None:
        self._model = model
        known = with_known_gain(model.network, model.network.measured[0], _GAIN_CHANNEL)
        heat = tuple(HeatInput(term.name, term.node) for term in model.network.terms)
        self._modal = ModalNetwork(replace(known, heat_inputs=(*known.heat_inputs, *heat), terms=()))

    def propagate(self, particles: Particles, walk: Walk, inputs: Array, gate: float) -> tuple[Particles, Array]:
        """One period on under `inputs` (n_u + m,): sampled quantities by their `walk`, then a Kalman prediction each.

        Also the logarithms (N,) of what each particle's proposal is worth.
        """
        sampled = self._switched(self._walked(particles, walk), walk)
        worth = self._worth(particles.gain_on, sampled.gain_on)
        model, options = self._model, self._model.options
        x, q = slice(0, model.states), slice(model.states, model.states + model.gains)
        c, phi = model.coefficients, slice(model.size - model.free, model.size)
        alpha = np.exp(sampled.log_alpha)
        mean, full = sampled.mean.copy(), unpack(sampled.covariance)
        for n in range(mean.shape[1]):
            gain = sampled.mean[q, n]
            jacobian = np.eye(model.size)
            move = self._linearised(sampled.mean[phi, n], inputs, gain, sampled.mean[c, n])
            mean[x, n], jacobian[x] = move(sampled.mean[x, n])
            noise = np.zeros(model.size)
            noise[x] = options.process_sd**2
            if options.volatility == "process":
                noise[x] *= alpha[model.block, n] ** 2
            if model.gains:
                decay = self._gain_decay(sampled.log_hours)[0, n]
                mean[q, n], jacobian[q, q] = decay * gain, decay
                noise[q] = sampled.gain_on[0, n] * self._gain_walk(alpha)[n] ** 2
            noise[c] = model.coefficient_walk
            noise[phi] = (gate * options.parameter_sd) ** 2
            full[n] = jacobian @ full[n] @ jacobian.T + np.diag(noise)
        if options.parameter_sd > 0 or model.terms:
            full = self._bounded(full)
        return sampled._replace(mean=mean, covariance=pack(full)), worth

    def assimilate(self, particles: Particles, outputs: Array) -> tuple[Particles, Array]:
        """Kalman update of every particle by every output (n_y,) that is not NaN, and their log likelihoods (N,)."""
        mean, covariance = particles.mean, particles.covariance
        log_likelihood = np.zeros(mean.shape[1])
        with np.errstate(over="ignore", invalid="ignore"):
            for row, (node, y) in enumerate(zip(self._model.topology.measured.tolist(), outputs, strict=True)):
                if not np.isnan(y):
                    noise = np.exp(2 * particles.log_noise[row])
                    step = kalman_update(mean, covariance, node, y, noise)
                    # P - P P / (P + R) is P R / (P + R), which keeps its digits where P is far above R.
                    rows = [packed(i, node) for i in range(self._model.size)]
                    step.covariance[rows] = covariance[rows] * (noise / (covariance[packed(node, node)] + noise))
                    mean, covariance = step.mean, step.covariance
                    log_likelihood = log_likelihood + step.log_likelihood
            mean, covariance = self._partly_updated(particles, mean, covariance)
            return particles._replace(mean=self._confined(mean, covariance), covariance=covariance), log_likelihood

    def sample(self, particles: Particles, index: Indices, normals: Array) -> Array:
        """Draws z (n_z, K) from the Gaussians of the particles `index` (K,), c and phi inside their bounds.

        `normals` (n_z, K) are standard normal.
        """
        factor = _semidefinite_roots(unpack(particles.covariance[:, index]))
        z = particles.mean[:, index] + np.einsum("kij,jk->ik", factor, normals)
        bounded = self._model.size - len(self._model.lower)
        z[bounded:] = np.clip(z[bounded:], self._model.lower[:, None], self._model.upper[:, None])
        return z

    def paths(self, start: Scenarios, plan: Array) -> Array:
        """Temperatures (h, n_y, K) of the measured nodes after each row of `plan` (h, n_u + m)."""
        model, options = self._model, self._model.options
        count, blocks = start.state.shape[1], len(model.blocks)
        phi, gain_at = start.state[model.size - model.free :], model.states
        theta = model.space.parameters(phi)
        tangents = [self._modal.linearise(theta[:, n], model.space.free[:0], model.period) for n in range(count)]
        transition = np.array([tangent.transition for tangent in tangents])
        response = np.array([tangent.input for tangent in tangents])
        x = start.state[: model.states]
        q = start.state[gain_at : gain_at + model.gains]
        coefficients = start.state[model.coefficients]
        log_alpha, on = start.log_alpha, start.gain_on
        temperatures = np.empty((len(plan), model.outputs, count))
        for ahead, inputs in enumerate(plan):
            draws = Draws(int(start.seed), int(start.step) + ahead + 1, forecast=True)
            rows, uniform_rows = model.scenario_shapes
            normals = draws.normals(Purpose.SCENARIO, (rows, count))
            uniforms = draws.uniforms(Purpose.SCENARIO_SWITCH, (uniform_rows, count))
            sizes, jumps, news, walks = np.split(
                normals[model.states :], np.cumsum([blocks, blocks, model.gains]).tolist()
            )
            log_alpha = walked_volatility(log_alpha, sizes, jumps, uniforms[:blocks], model.options)
            alpha = np.exp(log_alpha)
            on, new, spread = self._switches(on, uniforms[blocks:], model.on_probability)
            q = np.where(new, spread * news, q) * on
            measured, known = np.split(inputs, [len(inputs) - model.terms])
            power = np.concatenate(
                [np.repeat(measured[:, None], count, axis=1), self._heat(q), known[:, None] * coefficients]
            )
            noise = np.full((model.states, count), options.process_sd)
            if options.volatility == "process":
                noise *= alpha[model.block]
            x = np.einsum("kij,jk->ik", transition, x) + np.einsum("kij,jk->ik", response, power)
            x = x + noise * normals[: model.states]
            q = on * (self._gain_decay(start.log_hours) * q + self._gain_walk(alpha) * walks)
            temperatures[ahead] = x[model.topology.measured]
        return temperatures

    def _walked(self, particles: Particles, walk: Walk) -> Particles:
        """log alpha, log sigma_y and the log time constant one step on, each inside its bounds."""
        model, options, blocks = self._model, self._model.options, len(self._model.blocks)
        sizes, jumps, noise, hours = np.split(walk.normals, np.cumsum([blocks, blocks, model.outputs]).tolist())
        moved = particles.log_noise + options.hyper_walk_sd * noise * model.learns_noise
        return particles._replace(
            log_alpha=walked_volatility(particles.log_alpha, sizes, jumps, walk.uniforms[:blocks], model.options),
            log_noise=np.clip(moved, *model.noise_bounds),
            log_hours=np.clip(particles.log_hours + options.hyper_walk_sd * hours, *model.hour_bounds),
        )

    def _switches(self, on: Array, uniforms: Array, begin: float) -> tuple[Array, Array, Array]:
        """Whether the gain is on next and whether it is a new one (G, N), and the standard deviation of a new one.

        One begins with probability `begin`.
        """
        model = self._model
        switch, size = uniforms[: model.gains], uniforms[model.gains :]
        low, high = model.gain_sd_bounds
        spread = np.exp(low + (high - low) * size)
        begins = (on == 0) & (switch < begin)
        ends = (on == 1) & (switch < model.off_probability)
        return np.where(begins, 1.0, np.where(ends, 0.0, on)), begins, spread

    def _worth(self, before: Array, after: Array) -> Array:
        """Log of the gain's probability of moving from `before` to `after` (G, N), over that of the proposal, (N,)."""
        chance, proposed = self._model.on_probability, self._model.proposed_on_probability
        if chance == proposed:
            return np.zeros(before.shape[1])
        ratios = np.where(after == 1, np.log(chance / proposed), np.log((1 - chance) / (1 - proposed)))
        return np.asarray(np.where(before == 0, ratios, 0.0).sum(axis=0), dtype=np.float64)

    def _switched(self, particles: Particles, walk: Walk) -> Particles:
        """The gain switched: a new one is N(0, v^2), one that ended is known to be 0."""
        model = self._model
        if not model.gains:
            return particles
        on, new, spread = self._switches(
            particles.gain_on, walk.uniforms[len(model.blocks) :], model.proposed_on_probability
        )
        changed = (on != particles.gain_on)[0]
        mean, full = particles.mean.copy(), unpack(particles.covariance)
        mean[model.states, changed] = 0.0
        full[changed, model.states, :] = 0.0
        full[changed, :, model.states] = 0.0
        full[changed, model.states, model.states] = np.where(new, spread**2, 0.0)[0, changed]
        return particles._replace(mean=mean, covariance=pack(full), gain_on=on)

    def _linearised(
        self, phi: Array, inputs: Array, gain: Array, coefficients: Array
    ) -> Callable[[Array], tuple[Array, Array]]:
        """The step of one particle as a function from x (n_x,) to x' and its derivative (n_x, n_z) by z."""
        model = self._model
        theta = model.space.parameters(phi[:, None])[:, 0]
        tangent = self._modal.linearise(theta, model.space.free, model.period)
        measured, known = np.split(inputs, [len(inputs) - model.terms])
        heat = np.concatenate([measured, self._heat(gain) if model.gains else [0.0], known * coefficients])
        at = len(measured)

        def move(x: Array) -> tuple[Array, Array]:
            slope = tangent.transition_slope @ x + tangent.input_slope @ heat
            by_gain = WATTS * tangent.input[:, at : at + model.gains]
            by_coefficients = known * tangent.input[:, at + 1 :]
            later = tangent.transition @ x + tangent.input @ heat
            return later, np.hstack([tangent.transition, by_gain, by_coefficients, slope.T])

        return move

    def _heat(self, gain: Array) -> Array:
        """W from kW (G, ...); zero W without a gain."""
        return WATTS * gain if self._model.gains else np.zeros((1, *gain.shape[1:]))

    def _gain_decay(self, log_hours: Array) -> Array:
        """What is left of a gain after a step, (G, N)."""
        if not self._model.options.gain_decays:
            return np.ones_like(log_hours)
        return np.exp(-self._model.period / (HOUR * np.exp(log_hours)))

    def _gain_walk(self, alpha: Array) -> Array:
        """Standard deviation of the gain's random walk [kW], (N,)."""
        walk = np.full(alpha.shape[1], self._model.options.gain_walk_sd)
        return walk * alpha[0] if self._model.options.volatility == "gain" else walk

    def _bounded(self, full: Array) -> Array:
        """Covariances (N, n_z, n_z) in which no coefficient or log parameter varies more than under its prior."""
        bounded = self._model.size - len(self._model.lower)
        variances = np.einsum("nii->ni", full)[:, bounded:]
        scale = np.ones(full.shape[:2])
        scale[:, bounded:] = np.sqrt(np.minimum(1.0, self._model.prior_variance / variances))
        return full * scale[:, :, None] * scale[:, None, :]

    def _partly_updated(self, before: Particles, mean: Array, covariance: Array) -> tuple[Array, Array]:
        """The updated Gaussians of all particles, in which phi has taken only its share of the update.

        The covariance is P + D (P' - P) D, for that before, P', and after, P, where D is the root of the rest of the
        update for phi and 0 for the others: semidefinite as both are (partial update: Brink 2017).
        """
        phi, rest = self._model.size - self._model.free, 1.0 - self._model.news
        mean, covariance = mean.copy(), covariance.copy()
        mean[phi:] += rest * (before.mean[phi:] - mean[phi:])
        rows = [packed(i, j) for i in range(phi, self._model.size) for j in range(phi, i + 1)]
        covariance[rows] += rest * (before.covariance[rows] - covariance[rows])
        return mean, covariance

    def _confined(self, mean: Array, covariance: Array) -> Array:
        """Means with c and phi inside their bounds.

        A component that left it is put on its bound, and the others where they are most probable given that
        (projection of the estimate: Simon and Chia 2002); what then still sticks out is cut off.
        """
        lower, upper = self._model.lower, self._model.upper
        first = self._model.size - len(lower)
        mean = mean.copy()
        for d in range(len(lower)):
            row = covariance[[packed(i, first + d) for i in range(len(mean))]]
            excess = np.clip(mean[first + d], lower[d], upper[d]) - mean[first + d]
            mean = mean + row * np.where(row[first + d] > 0, excess / np.maximum(row[first + d], 1e-300), 0.0)
        mean[first:] = np.clip(mean[first:], lower[:, None], upper[:, None])
        return mean


def _semidefinite_roots(full: Array) -> Array:
    """Lower factors (K, n, n) of covariances that may be singular: a pivot that is only rounding counts as zero."""
    size = full.shape[1]
    factor = np.zeros_like(full)
    for j in range(size):
        column = full[:, :, j] - np.einsum("kil,kl->ki", factor, factor[:, j])
        pivot = column[:, j]
        sound = pivot > SMALLEST_PIVOT * full[:, j, j]
        root = np.sqrt(np.where(sound, pivot, 1.0))
        factor[:, j:, j] = np.where(sound, 1.0 / root, 0.0)[:, None] * column[:, j:]
    return factor
