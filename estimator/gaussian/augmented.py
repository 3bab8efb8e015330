"""Joint estimation of states and parameters in one Gaussian (paper 3.3, (14)-(16)): what EKF and UKF share.

The augmented state is s = [x; phi], phi = log theta of the free parameters, with a random walk (15). The filters differ
in one thing, the move of s over a step. The measurement is linear in s, so the update is the same: for it the sigma
points of the unscented transform give exactly the Kalman update.

These filters have no volatility and no particles: they name no blocks, and their updates leave out alpha, the gate and
N_eff.
"""

import math
from abc import ABC, abstractmethod

import numpy as np
from numba import njit
from scipy.special import ndtri

from estimator.arrays import Array
from estimator.gaussian.options import AugmentedOptions
from estimator.gaussian.square_root import Gaussian, condition_on, scalar_update, triangular_root
from estimator.kernels.draws import Draws, Purpose
from estimator.network.assembly import assemble, topology
from estimator.network.discretise import heat_loss, time_constants
from estimator.network.network import Network
from estimator.network.space import parameter_space
from estimator.network.starting import initial_temperatures
from estimator.types import LOG_SMALLEST, Mixture, Mixtures, ModelDraws, OneState, Outcome, ParameterSummary, Posterior

_SUMMARY_DRAWS = 2000
"""Draws from the posterior of phi for the quantiles of what is no monotone function of one parameter."""


class AugmentedFilter(OneState, ABC):
    """An EKF or UKF of one zone. Its state is N(s): n_x temperatures [degC], then d log parameters. See
    `estimator.types.Estimator` for the methods."""

    state_type = Gaussian

    mean_is_simulated: bool
    """Whether the mean moves as the network at the mean parameters moves."""

    def __init__(self, network: Network, period: float, options: AugmentedOptions) -> None:
        self.network = network.validate()
        self.period = period
        self.options = options
        self._size = len(network.nodes)
        self._measured = topology(network).measured
        self._space = parameter_space(network, logit=False)
        # Variance of the log-uniform prior (23).
        self._prior_sd = np.sqrt(self._space.prior_variance)

    @abstractmethod
    def move(self, gaussian: Gaussian, inputs: Array) -> Gaussian:
        """N(s_k) one period on under `inputs` (n_u,), noise included."""

    def start(self, seed: int, outputs: Array, inputs: Array) -> Gaussian:
        """Temperatures by their rules, log parameters with the spread of their prior around its middle or a draw."""
        place = np.full((len(self._prior_sd), 1), 0.5)
        if self.options.initial == "drawn":
            place = Draws(seed, 0).uniforms(Purpose.PRIOR_PARAMETERS, place.shape)
        temperatures, sds = initial_temperatures(self.network, outputs, inputs)
        mean = np.concatenate([temperatures, self._space.from_uniform(place)[:, 0]])
        return Gaussian(mean, np.diag(np.concatenate([sds, self._prior_sd])))

    def restart(self, state: Gaussian, outputs: Array, inputs: Array) -> Gaussian:
        """The first sample after a gap: temperatures as at the start, log parameters as they were."""
        temperatures, sds = initial_temperatures(self.network, outputs, inputs)
        size = len(temperatures)
        root = np.zeros_like(state.root)
        root[:size, :size] = np.diag(sds)
        root[size:, size:] = triangular_root(state.root[size:].T)
        return Gaussian(np.concatenate([temperatures, state.mean[size:]]), root)

    def predict(self, state: Gaussian, inputs: Array) -> Gaussian:
        """One period on under `inputs` (n_u,) held over the step."""
        mean, root = self.move(state, inputs)
        # The random walk would widen a parameter that the data say nothing about beyond its prior.
        narrow(root[self._size :], self._prior_sd)
        return Gaussian(mean, root)

    def predictive(self, state: Gaussian) -> Mixture:
        """N(H x, H P H^T + R) of every output, as a mixture of one."""
        variances = (state.root[self._measured] ** 2).sum(axis=1) + self.options.measurement_sd**2
        return Mixture(np.ones(1), state.mean[self._measured][:, None], np.sqrt(variances)[:, None])

    def update(self, state: Gaussian, outputs: Array) -> Posterior:
        """Kalman update with every output (n_y,) that is not NaN, one after the other; parameters kept in their box."""
        if np.isnan(outputs).all():
            return self._posterior(state, Outcome.MISSING)
        gaussian, log_likelihood = state, 0.0
        for node, y in zip(self._measured.tolist(), outputs.tolist(), strict=True):
            if y == y:
                gaussian, gained = scalar_update(gaussian, node, y, self.options.measurement_sd**2)
                log_likelihood += gained
        if not log_likelihood > LOG_SMALLEST:
            return self._posterior(state, Outcome.VANISHED)
        return self._posterior(self._confined(gaussian), Outcome.ASSIMILATED, log_likelihood)

    def parameters(self, state: Gaussian, levels: Array) -> ParameterSummary:
        """Quantiles: of theta those of a log-normal distribution cut off at the box, of the others from draws.

        The draws are the same at every call, so that equal states have equal quantiles.
        """
        size, free = self._size, self._space.free
        mean, root = state.mean[size:, None], state.root[size:]
        sds = np.sqrt((root**2).sum(axis=1))[:, None]
        theta = np.repeat(self._space.fixed[:, None], len(levels), axis=1)
        theta[free] = np.exp(self._space.confine(mean + sds * ndtri(levels)))
        normals = Draws(0, 0).normals(Purpose.PRIOR_PARAMETERS, (root.shape[1], _SUMMARY_DRAWS))
        matrices = assemble(self.network, self._space.parameters(self._space.confine(mean + root @ normals)))
        constants, losses = time_constants(matrices), heat_loss(matrices, int(self._measured[0]))
        return ParameterSummary(
            levels=levels,
            parameters=theta,
            time_constants=np.quantile(constants, levels, axis=0).T,
            heat_loss=np.quantile(losses, levels),
        )

    def unfold(self, issue: Gaussian, plan: Array) -> Mixtures:
        """What the issue forecasts under `plan` (h, n_u)."""
        now = self.predictive(issue)
        later, variances = self._outputs_ahead(issue, plan)
        means = np.concatenate([now.means.T, later])
        sds = np.concatenate([now.sds.T, np.sqrt(variances + self.options.measurement_sd**2)])
        return Mixtures.of_gaussians(means, sds)

    def draws(self, state: Gaussian, count: int) -> ModelDraws:
        """`count` draws of temperatures and log parameters, the same at every call: pairs that mirror each other about
        the mean, so that their mean is the filter's."""
        size, half = self._size, (count + 1) // 2
        normals = Draws(0, 0).normals(Purpose.MIXTURE_SAMPLE, (len(state.mean), half))
        drawn = state.mean[:, None] + state.root @ np.hstack([normals, -normals])[:, :count]
        shape = (size, count)
        return ModelDraws(
            network=self.network,
            point=self._space.parameters(state.mean[size:, None])[:, 0],
            mean=state.mean[:size],
            covariance=state.root[:size] @ state.root[:size].T,
            weights=np.full(count, 1.0 / count),
            theta=self._space.parameters(self._space.confine(drawn[size:])),
            state=drawn[:size],
            spread=np.zeros(shape),
            gain_decay=np.empty((0, count)),
            gain_stays=1.0,
            process_variance=np.full(shape, self.options.process_sd**2),
            measurement_variance=np.full((len(self._measured), count), self.options.measurement_sd**2),
            point_is_fan=self.mean_is_simulated,
        )

    def _outputs_ahead(self, state: Gaussian, plan: Array) -> tuple[Array, Array]:
        """Means and variances (h, n_y) of the measured nodes after each row of `plan` (h, n_u)."""
        means, variances = np.empty((2, len(plan), len(self._measured)))
        for ahead, inputs in enumerate(plan):
            state = self.predict(state, inputs)
            means[ahead], variances[ahead] = state.mean[self._measured], (state.root[self._measured] ** 2).sum(axis=1)
        return means, variances

    def _confined(self, gaussian: Gaussian) -> Gaussian:
        """With the parameters inside their box.

        One that left it is put on its bound, and the other components where they are most probable given that
        (projection of the estimate: Simon and Chia 2002); what then still sticks out is cut off.
        """
        size = self._size
        for i, (low, high) in enumerate(zip(self._space.lower.tolist(), self._space.upper.tolist(), strict=True)):
            value = float(gaussian.mean[size + i])
            if not low <= value <= high:
                gaussian = condition_on(gaussian, size + i, min(max(value, low), high))
        mean = gaussian.mean.copy()
        mean[size:] = np.clip(mean[size:], self._space.lower, self._space.upper)
        return gaussian._replace(mean=mean)

    def _posterior(self, state: Gaussian, outcome: Outcome, log_likelihood: float = float("nan")) -> Posterior:
        theta = self._space.from_logs(state.mean[self._size :])
        return Posterior(state=state, outcome=outcome, log_likelihood=log_likelihood, parameters=theta)


@njit(cache=True, nogil=True)
def narrow(rows, sds):  # type: ignore[no-untyped-def]
    """Scale `rows` (d, n) of a root so that no component has a spread above `sds` (d,)."""
    for i in range(len(rows)):
        spread = math.sqrt((rows[i] ** 2).sum())
        if spread > sds[i]:
            rows[i] *= sds[i] / spread
