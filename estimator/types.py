"""What an online estimator takes and gives: the protocol behind which RBPF, EKF and UKF stand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from estimator.arrays import Array, Indices
from estimator.kernels.quantiles import mixture_quantiles
from estimator.network.network import Network

ALPHA_LEVELS = (0.025, 0.5, 0.975)
"""Levels of the quantiles of the volatility alpha."""


LOG_SMALLEST = float(np.log(np.finfo(float).tiny))
"""Below this log weight every weight would be zero in floating point: no particle explains the measurement at all."""


class Outcome(StrEnum):
    """What an update did with its sample."""

    ASSIMILATED = "assimilated"
    MISSING = "missing"
    """No output was measured: nothing was updated."""
    VANISHED = "vanished"
    """No likelihood above the smallest float (an outlier, a stuck sensor): the prior was kept."""


class Mixture(NamedTuple):
    """A Gaussian mixture over the outputs: `weights` (N,), `means` and `sds` (n_y, N) in degC and K."""

    weights: Array
    means: Array
    sds: Array

    def mean(self) -> Array:
        """Mean of every output, shape (n_y,)."""
        return self._weighted(self.means)

    def sd(self) -> Array:
        """Standard deviation of every output, shape (n_y,)."""
        apart = self.means - self.mean()[:, None]
        return np.sqrt(self._weighted(self.sds * self.sds + apart * apart))

    def quantiles(self, levels: Array, output: int) -> Array:
        """Quantiles (L,) of one output [degC] at `levels` (L,)."""
        deviates, means, sds = ndtri(levels), self.means[output], self.sds[output]
        if len(means) == 1:
            return np.asarray(means[0] + sds[0] * deviates, dtype=np.float64)
        return np.asarray(mixture_quantiles(levels, deviates, self.weights, means, sds), dtype=np.float64)

    def _weighted(self, rows: Array) -> Array:
        # A sum of NumPy's own: a matrix product may depend on how many threads its library takes.
        found: Array = np.add.reduce(rows * self.weights, axis=1)
        return found


class Mixtures(NamedTuple):
    """One Gaussian mixture for each of L successive times: `weights` (L, N), `means` and `sds` (L, n_y, N)."""

    weights: Array
    means: Array
    sds: Array

    @classmethod
    def of_gaussians(cls, means: Array, sds: Array) -> Mixtures:
        """Mixtures of one: `means` and `sds` (L, n_y)."""
        return cls(np.ones((len(means), 1)), means[..., None], sds[..., None])

    @classmethod
    def of_one(cls, mixture: Mixture) -> Mixtures:
        """The mixture of a single time."""
        return cls(*(rows[None] for rows in mixture))

    def moments(self) -> tuple[Array, Array]:
        """Means and standard deviations (L, n_y)."""
        shares = (self.weights / self.weights.sum(axis=1, keepdims=True))[:, None]
        means = (shares * self.means).sum(axis=2)
        return means, np.sqrt((shares * (self.sds**2 + (self.means - means[..., None]) ** 2)).sum(axis=2))

    def during(self, times: slice | Indices) -> Mixtures:
        """Those of some of the times."""
        return Mixtures(*(rows[times] for rows in self))

    def at(self, place: int) -> Mixture:
        """The mixture of one time."""
        # The weights may be one row for all times, which is read-only: a type that the kernels are not compiled for.
        return Mixture(self.weights[place].copy(), self.means[place], self.sds[place])

    def each(self) -> Iterator[Mixture]:
        """The mixtures, the earliest first."""
        return map(self.at, range(len(self.means)))

    def after(self, first: Mixture) -> Mixtures:
        """These with `first` before them; who has fewer components gets some that weigh nothing."""
        count = max(len(first.weights), self.weights.shape[1])
        return Mixtures(
            np.concatenate([_filled(first.weights[None], count, 0.0), _filled(self.weights, count, 0.0)]),
            np.concatenate([_filled(first.means[None], count, 0.0), _filled(self.means, count, 0.0)]),
            np.concatenate([_filled(first.sds[None], count, 1.0), _filled(self.sds, count, 1.0)]),
        )


def _filled(rows: Array, count: int, value: float) -> Array:
    missing = np.full((*rows.shape[:-1], count - rows.shape[-1]), value)
    return np.concatenate([rows, missing], axis=-1) if missing.size else rows


def mixture_moments(weights: Array, means: Array, covariances: Array) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of a mixture of N Gaussians: `weights` (N,), `means` (n, N), `covariances`
    (N, n, n)."""
    shares = weights / weights.sum()
    mean = (means * shares).sum(axis=1)
    apart = means - mean[:, None]
    covariance = np.einsum("k,kij->ij", shares, covariances) + (apart * shares) @ apart.T
    return np.asarray(mean, dtype=np.float64), np.asarray(covariance, dtype=np.float64)


class Disturbance(NamedTuple):
    """What an estimator knows of what it cannot measure, at the levels .025, .5 and .975."""

    gain: Array
    """(3,): unmeasured heat [W] into the first measured node over the last step, that of habits included; NaN without a
    model of it."""
    probability_on: float
    """That there is such heat beside that of habits; NaN without a model of it."""
    measurement_sd: Array
    """(n_y, 3): sigma_y [K] of every output."""


class Verified(NamedTuple):
    """What had been forecast for a sample."""

    lead: int
    """How many steps before."""
    mixture: Mixture
    """The distribution of the outputs."""


class Posterior(NamedTuple):
    """What one update learned. Arrays over volatility blocks have shape (B,), over parameters (n_theta,).

    What not every estimator has comes last and need not be given.
    """

    state: Any
    outcome: Outcome
    log_likelihood: float
    """log p(y_k | y_1:k-1); NaN when nothing was assimilated."""
    parameters: Array
    """(n_theta,): posterior mean of each log parameter, exponentiated; fixed ones at their value."""
    alpha_quantiles: Array = np.empty((0, len(ALPHA_LEVELS)))
    """(B, 3): quantiles of alpha_k at ALPHA_LEVELS; B is 0 where the estimator has no volatility."""
    cdf: Array = np.empty(0)
    """(B,): F_k, where the median of alpha_k stands in its own history."""
    gate: float | None = None
    """g_k, the smallest over blocks, 0 where nothing was learned; None for an estimator without a gate."""
    regime: str | None = None
    """What F_k stands for: "low", "transitional" or "high" volatility, the highest over blocks."""
    effective_sample_size: float | None = None
    """N_eff; None for an estimator without particles."""
    resampled: bool = False
    floored: bool = False
    """Whether the parameter covariance had collapsed and was held at its floor."""
    disturbance: Callable[[Array], Disturbance] | None = None
    """Of this update, from the drive row of the step that ended with it, worked out when asked for: of most members of
    a bank nobody does. None for an estimator that has no model of disturbances."""
    verified: tuple[Verified, ...] = ()
    """Forecasts of this very sample whose time has come, of an estimator that verifies itself."""


class ParameterSummary(NamedTuple):
    """Posterior quantiles, at `levels` (n_levels,), of theta, time constants and the heat-loss coefficient."""

    levels: Array
    parameters: Array
    """(n_theta, n_levels) in each parameter's own unit."""
    time_constants: Array
    """(n_x, n_levels) in seconds, fastest first."""
    heat_loss: Array
    """(n_levels,) in W/K, seen from the first measured node to all boundaries in steady state."""
    coefficients: Array = np.empty((0, 0))
    """(m, n_levels): coefficients of the network's terms, each in its own unit; no row where they are not learned."""
    collapsed: npt.NDArray[np.bool_] = np.empty(0, dtype=np.bool_)
    """(n_theta + n_x + 1,): which intervals of parameters, time constants and heat loss have collapsed, once somebody
    looked (`estimator.believed`); empty before."""

    @classmethod
    def unknown(cls, network: Network, levels: Array) -> ParameterSummary:
        """Not a number throughout: that of a model without the parameters of a building."""
        none = np.full(len(levels), np.nan)
        parameters, constants = (np.tile(none, (len(of), 1)) for of in (network.parameters, network.nodes))
        return cls(levels, parameters, constants, none)


class ModelDraws(NamedTuple):
    """K linear models that a state stands for. Powers are in W, temperatures in degC, variances are per period.

    The unmeasured gain enters the first measured node. Over a period it is switched off or stays (`gain_stays`), heats
    the node, and then decays; G is 1 where the estimator has such a gain and 0 where it has none.
    """

    network: Network
    """Of these models: a bank's member may have another one than the bank."""
    point: Array
    """(n_theta,): exponential of the posterior mean of the log parameters."""
    mean: Array
    """(n_x + G,): posterior mean of temperatures and gain."""
    covariance: Array
    """(n_x + G, n_x + G): their posterior covariance."""
    weights: Array
    """(K,): they add up to 1."""
    theta: Array
    """(n_theta, K)."""
    state: Array
    """(n_x + G, K): temperatures and gain of each draw."""
    spread: Array
    """(n_x + G, K): standard deviations of what each draw's state leaves open."""
    gain_decay: Array
    """(G, K): what is left of the gain after a period."""
    gain_stays: float
    """Probability that a gain that is on stays on over a period."""
    process_variance: Array
    """(n_x + G, K)."""
    measurement_variance: Array
    """(n_y, K): sigma_y^2 [K^2]."""
    coefficients: Array = np.empty((0, 0))
    """(m, K): coefficients of the terms of `network`; no row where it has none."""
    point_is_fan: bool = False
    """Whether the model at `point`, started at `mean`, is the one whose simulation is the mean of the fan; otherwise
    the weighted mean over the draws is, within their sampling error."""
    member: str = ""
    """Which member of a bank this is; empty where there is no bank."""
    share: float = 1.0
    """What that member weighs in the bank's forecast a few hours ahead, 0 to 1; 1 where there is no bank."""


class Estimator(Protocol):
    """An online estimator of one zone. Every method is pure: the states passed in are never changed.

    The inputs of a step are a drive row of `network`: the n_u measured inputs, then the known f of each of its m terms
    (`estimator.network.terms`). Most networks have no terms.
    """

    network: Network
    period: float
    """Sampling period in s."""
    blocks: tuple[str, ...]
    """Names of the volatility blocks; none where the noise covariance is fixed."""

    forecast_draws: int
    """Draws that a forecast over several steps is made of at most."""

    physical: bool
    """Whether its parameters are those of a building."""
    verifies_itself: bool
    """Whether `update` tells how the estimator's own forecasts hours ahead have turned out."""

    @property
    def issue_type(self) -> type[Any]:
        """The NamedTuple of arrays that `issue` makes."""

    def start(self, seed: int, outputs: Array, inputs: Array) -> Any:
        """State at the first sample: outputs (n_y,) and inputs (n_u,) measured there."""

    def restart(self, state: Any, outputs: Array, inputs: Array) -> Any:
        """State at the first sample after a gap: thermal states wide again, parameters and volatility kept."""

    def predict(self, state: Any, inputs: Array) -> Any:
        """State one period on, under `inputs` (n_u,) held over the step. Nothing is learned."""

    def predictive(self, state: Any) -> Mixture:
        """Distribution of the outputs (n_y,) at the state's time."""

    def update(self, state: Any, outputs: Array) -> Posterior:
        """Learn from `outputs` (n_y,); NaN marks a missing one."""

    def parameters(self, state: Any, levels: Array) -> ParameterSummary:
        """Posterior quantiles of the parameters and of what follows from them."""

    def issue(self, state: Any, count: int) -> Any:
        """What is needed to forecast from `state` later on: an `issue_type` that stands for at most `count` draws."""

    def unfold(self, issue: Any, plan: Array) -> Mixtures:
        """What `issue` forecasts, at its state's time and then after each row of `plan` (h, n_u): L = h + 1."""

    def draws(self, state: Any, count: int) -> ModelDraws | None:
        """At most `count` linear models that `state` stands for; None for an estimator without physics.

        Asking changes nothing in what the estimator will draw.
        """

    def verified(self, state: Any, lead: int, errors: Array) -> Any:
        """`state` after the errors (n_y,) [K] of a forecast `lead` steps ahead became known; NaN: not measured."""

    def member_weights(self, state: Any) -> Mapping[str, Array]:
        """What each member weighs at each horizon, (H,) by name; nothing where there are no members."""

    def pack(self, state: Any) -> dict[str, Array]:
        """The arrays of a state, by name."""

    def unpack(self, arrays: Mapping[str, Array]) -> Any:
        """The state of packed arrays, with the same bits."""


class OneState:
    """What an estimator does by default: its state is one NamedTuple of arrays, and also what it issues."""

    state_type: ClassVar[type[Any]]
    """That NamedTuple."""
    blocks: tuple[str, ...] = ()
    forecast_draws = 1
    physical = True
    verifies_itself = False

    @property
    def issue_type(self) -> type[Any]:
        """The state."""
        return self.state_type

    def issue(self, state: Any, count: int) -> Any:
        """The state itself, whatever the `count`."""
        return state

    def verified(self, state: Any, lead: int, errors: Array) -> Any:
        """The state itself: nothing is learned from errors hours ahead."""
        return state

    def member_weights(self, state: Any) -> Mapping[str, Array]:
        """None: there are no members."""
        return {}

    def pack(self, state: Any) -> dict[str, Array]:
        """The arrays of a state, by name."""
        return state._asdict()

    def unpack(self, arrays: Mapping[str, Array]) -> Any:
        """The state of packed arrays."""
        return self.state_type(**arrays)
