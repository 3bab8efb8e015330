"""An online ARX model: every output from its own past and that of the inputs, by recursive least squares.

y_(k+1) = c + sum_i a_i y_(k+1-i) + sum_j sum_i b_ji u_j,(k+1-i): linear regression on past outputs and inputs, updated
with every sample under exponential forgetting (Ljung 1999, chapter 11). Before any sample it is persistence, to which
its ridge prior draws it. It has no parameters of a building; those are reported as not a number.

A regression that fits one step well is too sure of itself over hours. So the spread of a forecast comes from the errors
of forecasts whose time has come (`verified`), and from the residuals of one step only until there are some.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import exp
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import ndtri

from estimator.arrays import Array
from estimator.blackbox.options import ARXOptions
from estimator.network.network import Network
from estimator.types import Mixture, Outcome, ParameterSummary, Posterior

_SCALE = {"degC": 10.0, "W": 1000.0, "W/m2": 100.0}
"""What a channel of this unit varies by: inputs are divided by it, so that one prior suits all."""
_PRIOR_SD = 0.3
"""Standard deviation of every scaled coefficient a priori."""
_FIRST_SD = 0.1
"""Standard deviation [K] of a residual before there is any."""
_LEVEL = 20.0
"""degC that temperatures count from."""
_FARTHEST = 15.0
"""K beyond the last outputs that no forecast goes: a regression on little data may be unstable."""
_SURE = 5.0
"""Verified errors whose weight equals that of the theory."""
_DAY = 86400.0


class ARXState(NamedTuple):
    """n_y regressions of p coefficients each; L leads at which errors have been verified."""

    coefficients: Array
    """(n_y, p)."""
    covariance: Array
    """(n_y, p, p): of the coefficients, for a residual of variance 1."""
    outputs: Array
    """(n_y, past_outputs + 1) [degC], newest first; forecasts where nothing was measured."""
    inputs: Array
    """(past_inputs, n_u), newest first."""
    residual: Array
    """(n_y, 2): discounted sum of squared residuals [K^2] and of their weights."""
    errors: Array
    """(L, n_y, 2): the same of verified forecasts, lead by lead."""
    leads: Array
    """(L,): those leads, in steps; 0 where a place is free."""
    echo: Array
    """(n_y, past_outputs): what a residual at the last measurement leaves of itself, newest first; 0 once measured."""
    spread: Array
    """(n_y,): sum of the squares of all such shares since then."""


_LEADS = 8


class ARX:
    """The model of one zone. See `estimator.types.Estimator` for the moves."""

    def __init__(self, network: Network, period: float, options: ARXOptions) -> None:
        self.network = network.validate()
        self.period = period
        self.options = options
        self.blocks: tuple[str, ...] = ()
        units = [network.channel_unit(channel) for channel in network.inputs]
        self._scale = np.array([_SCALE.get(unit, 1.0) for unit in units])
        self._level = np.array([_LEVEL if unit == "degC" else 0.0 for unit in units])
        self._width = 1 + options.past_outputs + options.past_inputs * len(units)
        self._prior = (_PRIOR_SD / _FIRST_SD) ** 2
        self._forgetting = exp(-period / (options.memory_days * _DAY))
        self._verified_forgetting = exp(-3600.0 / (options.verified_memory_days * _DAY))

    physical = False
    verifies_itself = False

    @property
    def issue_type(self) -> type[ARXState]:
        """The model's state."""
        return ARXState

    def start(self, seed: int, outputs: Array, inputs: Array) -> ARXState:
        """Persistence, from the first sample: its outputs (n_y,) and inputs (n_u,)."""
        count = len(self.network.measured)
        coefficients = np.zeros((count, self._width))
        coefficients[:, 1] = 1.0
        return ARXState(
            coefficients=coefficients,
            covariance=np.tile(self._prior * np.eye(self._width), (count, 1, 1)),
            outputs=self._filled(outputs),
            inputs=np.tile(inputs, (self.options.past_inputs, 1)),
            residual=np.tile([_FIRST_SD**2, 1.0], (count, 1)),
            errors=np.zeros((_LEADS, count, 2)),
            leads=np.zeros(_LEADS),
            echo=np.zeros((count, self.options.past_outputs)),
            spread=np.zeros(count),
        )

    def restart(self, state: ARXState, outputs: Array, inputs: Array) -> ARXState:
        """The first sample after a gap: another past, the same regression."""
        return state._replace(
            outputs=self._filled(outputs),
            inputs=np.tile(inputs, (self.options.past_inputs, 1)),
            echo=np.zeros_like(state.echo),
            spread=np.zeros_like(state.spread),
        )

    def predict(self, state: ARXState, inputs: Array) -> ARXState:
        """One period on under `inputs` (n_u,) held over the step."""
        past = _shifted(state.inputs.T, inputs).T
        outputs, echo, spread = _moved(
            state.coefficients, state.outputs, self._scaled(past), state.echo, state.spread, _LEVEL, _FARTHEST
        )
        return state._replace(outputs=outputs, inputs=past, echo=echo, spread=spread)

    def predictive(self, state: ARXState) -> Mixture:
        """A Gaussian for every output at the state's time, as a mixture of one."""
        return Mixture(np.ones(1), state.outputs[:, :1], self._theory(state)[:, None])

    def quantiles(self, mixture: Mixture, levels: Array, output: int) -> Array:
        """Gaussian quantiles (L,) of one output."""
        return np.asarray(mixture.means[output, 0] + mixture.sds[output, 0] * ndtri(levels), dtype=np.float64)

    def update(self, state: ARXState, outputs: Array) -> Posterior:
        """Learn from `outputs` (n_y,), the newest of which `state` has forecast; NaN for a missing one."""
        measured = ~np.isnan(outputs)
        if not measured.any():
            return self._posterior(state, Outcome.MISSING)
        sds = self._theory(state)
        if not (np.abs(outputs - state.outputs[:, 0])[measured] < _FARTHEST + 10.0 * sds[measured]).all():
            return self._posterior(state, Outcome.VANISHED)
        learned = ARXState(*(array.copy() for array in state))
        regressors, log_likelihood = self._scaled(state.inputs), 0.0
        for i in np.flatnonzero(measured):
            error = outputs[i] - state.outputs[i, 0]
            log_likelihood -= 0.5 * (error / sds[i]) ** 2 + float(np.log(sds[i] * np.sqrt(2.0 * np.pi)))
            # What the regression explains is the step from the last measurement; a forecast of a forecast is none.
            if state.spread[i] == 1.0:
                row = _row(state.outputs[i, 1:], regressors, _LEVEL)
                _learn(learned.coefficients[i], learned.covariance[i], row, error, self._forgetting, self._prior)
                learned.residual[i] = state.residual[i] * self._forgetting + np.array([error**2, 1.0])
            learned.outputs[i, 0], learned.echo[i], learned.spread[i] = outputs[i], 0.0, 0.0
        return self._posterior(learned, Outcome.ASSIMILATED, log_likelihood)

    def forecast(self, state: ARXState, plan: Array) -> Iterator[Mixture]:
        """The outputs at the state's time and after each row of `plan` (h, n_u)."""
        yield self.predictive(state)
        for ahead, inputs in enumerate(plan, start=2):
            state = self.predict(state, inputs)
            sds = self._spread(state, ahead)
            yield Mixture(np.ones(1), state.outputs[:, :1], sds[:, None])

    def issue(self, state: ARXState, count: int) -> ARXState:
        """The state itself: one forecast."""
        return state

    def unfold(self, issue: ARXState, plan: Array) -> Iterator[Mixture]:
        """What the issue forecasts under `plan` (h, n_u)."""
        return self.forecast(issue, plan)

    def verified(self, state: ARXState, lead: int, errors: Array) -> ARXState:
        """Learn from the errors (n_y,) [K] of a forecast `lead` steps ahead whose time has come; NaN where unknown."""
        place = np.flatnonzero((state.leads == lead) | (state.leads == 0.0))
        if not len(place) or np.isnan(errors).all():
            return state
        leads, sums = state.leads.copy(), state.errors.copy()
        leads[place[0]] = lead
        known = ~np.isnan(errors)
        sums[place[0], known] *= self._verified_forgetting
        sums[place[0], known] += np.column_stack([errors[known] ** 2, np.ones(known.sum())])
        return state._replace(leads=leads, errors=sums)

    def parameters(self, state: ARXState, levels: Array) -> ParameterSummary:
        """Not a number throughout: the model has no parameters of a building."""
        none = np.full(len(levels), np.nan)
        return ParameterSummary(
            levels=levels,
            parameters=np.tile(none, (len(self.network.parameters), 1)),
            time_constants=np.tile(none, (len(self.network.nodes), 1)),
            heat_loss=none,
        )

    def member_weights(self, state: ARXState) -> Mapping[str, Array]:
        """None: there are no members."""
        return {}

    def pack(self, state: ARXState) -> dict[str, Array]:
        """The arrays of a state, by name."""
        return state._asdict()

    def unpack(self, arrays: Mapping[str, Array]) -> ARXState:
        """The state of packed arrays."""
        return ARXState(**arrays)

    def _spread(self, state: ARXState, lead: int) -> Array:
        """Standard deviation (n_y,) [K] `lead` steps ahead: the regression's own where nothing was verified."""
        theory = self._theory(state)
        at = np.flatnonzero(state.leads > 0.0)
        if not len(at):
            return theory
        order = at[np.argsort(state.leads[at])]
        squares, weights = state.errors[order, :, 0], state.errors[order, :, 1]
        own = np.array([np.interp(np.log(lead), np.log(state.leads[order]), w) for w in weights.T])
        roots = np.sqrt(squares / np.maximum(weights, 1e-9))
        seen = np.array([np.interp(np.log(lead), np.log(state.leads[order]), r) for r in roots.T])
        return np.sqrt((_SURE * theory**2 + own * seen**2) / (_SURE + own))

    def _theory(self, state: ARXState) -> Array:
        """Standard deviation (n_y,) [K] at the state's time, if residuals were independent."""
        variance = state.residual[:, 0] / state.residual[:, 1]
        return np.sqrt(variance * np.clip(state.spread, 1e-6, (_FARTHEST / _FIRST_SD) ** 2))

    def _filled(self, outputs: Array) -> Array:
        """A past (n_y, past_outputs) in which nothing has changed."""
        first = float(np.nanmean(outputs)) if np.isfinite(outputs).any() else _LEVEL
        return np.tile(np.where(np.isnan(outputs), first, outputs)[:, None], self.options.past_outputs + 1)

    def _scaled(self, past: Array) -> Array:
        """The inputs (past_inputs, n_u) as regressors, in a row."""
        return ((past - self._level) / self._scale).ravel()

    def _posterior(self, state: ARXState, outcome: Outcome, log_likelihood: float = float("nan")) -> Posterior:
        return Posterior(
            state=state,
            outcome=outcome,
            log_likelihood=log_likelihood,
            parameters=np.full(len(self.network.parameters), np.nan),
        )


def _shifted(past: Array, newest: Array) -> Array:
    """`past` (m, L) with `newest` (m,) in front and the oldest gone."""
    return np.concatenate([newest[:, None], past[:, :-1]], axis=1)


@njit(cache=True)
def _row(past, inputs, level):  # type: ignore[no-untyped-def]
    """Regressors (p,): 1, past outputs from `level` [degC], scaled inputs."""
    row = np.empty(1 + past.shape[0] + inputs.shape[0])
    row[0] = 1.0
    row[1 : 1 + past.shape[0]] = past - level
    row[1 + past.shape[0] :] = inputs
    return row


@njit(cache=True)
def _moved(coefficients, outputs, inputs, echo, spread, level, farthest):  # type: ignore[no-untyped-def]
    """Outputs, echo and spread one step on."""
    later, later_echo, later_spread = np.empty_like(outputs), np.empty_like(echo), np.empty_like(spread)
    past = echo.shape[1]
    for i in range(outputs.shape[0]):
        row = _row(outputs[i, :past], inputs, level)
        value = level + np.sum(row * coefficients[i])
        low, high = outputs[i].min() - farthest, outputs[i].max() + farthest
        later[i, 0] = min(max(value, low), high)
        later[i, 1:] = outputs[i, :-1]
        share = 1.0 if spread[i] == 0.0 else np.sum(coefficients[i, 1 : 1 + past] * echo[i])
        # An unstable regression, of which few samples may think well, must not grow beyond all numbers.
        later_echo[i, 0] = min(max(share, -1e3), 1e3)
        later_echo[i, 1:] = echo[i, :-1]
        later_spread[i] = spread[i] + later_echo[i, 0] ** 2
    return later, later_echo, later_spread


@njit(cache=True)
def _learn(coefficients, covariance, row, error, forgetting, most):  # type: ignore[no-untyped-def]
    """One step of recursive least squares, in place; no variance grows beyond `most`, the prior's."""
    column = np.zeros(len(row))
    for j in range(len(row)):
        for k in range(len(row)):
            column[j] += covariance[j, k] * row[k]
    total = forgetting + np.sum(row * column)
    coefficients += column * (error / total)
    widest = 0.0
    for j in range(len(row)):
        for k in range(len(row)):
            covariance[j, k] -= column[j] * column[k] / total
        widest = max(widest, covariance[j, j])
    if widest < forgetting * most:
        covariance /= forgetting
