"""An online ARX model: every output from its own past and that of the inputs, by recursive least squares.

y_(k+1) = c + sum_i a_i y_(k+1-i) + sum_j sum_i b_ji u_j,(k+1-i): linear regression on past outputs and inputs, updated
with every sample under exponential forgetting (Ljung 1999, chapter 11). Before any sample it is persistence, to which
its ridge prior draws it. It has no parameters of a building; those are reported as not a number.

A regression that fits one step well is too sure of itself over hours. So the spread of a forecast comes from the errors
of forecasts whose time has come (`verified`), and from the residuals of one step only until there are some.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import DAY, Array
from estimator.blackbox.options import ARXOptions
from estimator.blackbox.regression import FARTHEST, LEVEL, Regression
from estimator.network.network import Network
from estimator.types import Mixture, Mixtures, Outcome, Posterior

_PRIOR_SD = 0.3
"""Standard deviation of every scaled coefficient a priori."""
_FIRST_SD = 0.1
"""Standard deviation [K] of a residual before there is any."""
_LEAST_SD = 1e-6
"""Standard deviation [K] of a residual at least: that of a sensor which stands still would vanish."""
_BEYOND, _BEYOND_SHARE = 2.0, 0.5
"""K, and share of the range measured so far, that a forecast may leave that range by: a regression on little data may
be unstable."""
_WIDEST_SPREAD = (FARTHEST / _FIRST_SD) ** 2
"""Squares of a residual that a spread comes to at most."""
_RESIDUAL_DAYS = 2.0
"""Time constant with which old residuals are forgotten [d]: the first ones, of a regression that knew nothing, soon."""
_SURE = 5.0
"""Verified errors whose weight equals that of the theory."""


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
    seen: Array
    """(n_y, 2): lowest and highest output measured so far [degC]."""


_LEADS = 8


class ARX(Regression):
    """The model of one zone. See `estimator.types.Estimator` for the moves."""

    state_type = ARXState

    def __init__(self, network: Network, period: float, options: ARXOptions) -> None:
        super().__init__(network, period)
        self.options = options
        self._width = 1 + options.past_outputs + options.past_inputs * len(self.level)
        self._prior = (_PRIOR_SD / _FIRST_SD) ** 2
        self._forgetting = math.exp(-period / (options.memory_days * DAY))
        self._residual_forgetting = math.exp(-period / (min(options.memory_days, _RESIDUAL_DAYS) * DAY))
        # Of each lead an error becomes known every hour, or with every sample.
        self._verified_forgetting = math.exp(-max(3600.0, period) / (options.verified_memory_days * DAY))

    def start(self, seed: int, outputs: Array, inputs: Array) -> ARXState:
        """Persistence, from the first sample: its outputs (n_y,) and inputs (n_u,)."""
        count = len(self.network.measured)
        coefficients = np.zeros((count, self._width))
        coefficients[:, 1] = 1.0
        filled = self._past(outputs)
        return ARXState(
            coefficients=coefficients,
            covariance=np.tile(self._prior * np.eye(self._width), (count, 1, 1)),
            outputs=filled,
            inputs=np.tile(inputs, (self.options.past_inputs, 1)),
            residual=np.tile([_FIRST_SD**2, 1.0], (count, 1)),
            errors=np.zeros((_LEADS, count, 2)),
            leads=np.zeros(_LEADS),
            echo=np.zeros((count, self.options.past_outputs)),
            spread=np.zeros(count),
            seen=filled[:, :2].copy(),
        )

    def bounds(self, state: ARXState) -> Array:
        """(n_y, 2): the lowest and the highest output [degC] that a forecast from `state` tells: some way beyond what
        was measured so far."""
        return np.asarray(_bounds(state.seen))

    def restart(self, state: ARXState, outputs: Array, inputs: Array) -> ARXState:
        """The first sample after a gap: another past, the same regression."""
        lowest, highest = state.seen.T
        return state._replace(
            seen=np.column_stack([np.fmin(lowest, outputs), np.fmax(highest, outputs)]),
            outputs=self._past(outputs),
            inputs=np.tile(inputs, (self.options.past_inputs, 1)),
            echo=np.zeros_like(state.echo),
            spread=np.zeros_like(state.spread),
        )

    def predict(self, state: ARXState, inputs: Array) -> ARXState:
        """One period on under `inputs` (n_u,) held over the step."""
        past = np.concatenate([inputs[None], state.inputs[:-1]])
        outputs, echo, spread = state.outputs.copy(), state.echo.copy(), state.spread.copy()
        _move(state.coefficients, outputs, self._scaled(past).ravel(), echo, spread, _bounds(state.seen))
        return ARXState(*state[:2], outputs, past, *state[4:7], echo, spread, state.seen)

    def predictive(self, state: ARXState) -> Mixture:
        """A Gaussian for every output at the state's time, as a mixture of one."""
        return Mixture(np.ones(1), state.outputs[:, :1], _theory(state.residual, state.spread)[:, None])

    def update(self, state: ARXState, outputs: Array) -> Posterior:
        """Learn from `outputs` (n_y,), the newest of which `state` has forecast; NaN for a missing one."""
        missing, sds = np.isnan(outputs), _theory(state.residual, state.spread)
        if missing.all():
            return self._posterior(state, Outcome.MISSING)
        if not (missing | (np.abs(outputs - state.outputs[:, 0]) < FARTHEST + 10.0 * sds)).all():
            return self._posterior(state, Outcome.VANISHED)
        learned = ARXState(*(array.copy() for array in state))
        memory = self._forgetting, self._residual_forgetting, self._prior
        log_likelihood = _assimilate(learned, self._scaled(state.inputs).ravel(), sds, outputs, memory)
        return self._posterior(learned, Outcome.ASSIMILATED, log_likelihood)

    def futures(self, state: ARXState, plan: Array) -> tuple[Array, Array]:
        """Means and standard deviations (h + 1, n_y) at the state's time and after each row of `plan` (h, n_u)."""
        scaled = self._scaled(np.concatenate([state.inputs[::-1], plan]))[::-1]
        means, sds = _moved(
            state.coefficients, state.outputs, np.ascontiguousarray(scaled), self.options.past_inputs, state.echo,
            state.spread, _bounds(state.seen),
        )  # fmt: skip
        _spread(sds, _residual_sd(state.residual), state.errors, state.leads)
        return means, sds

    def unfold(self, issue: ARXState, plan: Array) -> Mixtures:
        """What the issue forecasts under `plan` (h, n_u)."""
        return Mixtures.of_gaussians(*self.futures(issue, plan))

    def verified(self, state: ARXState, lead: int, errors: Array) -> ARXState:
        """Learn from the errors (n_y,) [K] of a forecast `lead` steps ahead whose time has come; NaN where unknown."""
        leads, sums = state.leads.copy(), state.errors.copy()
        _verify(leads, sums, lead, errors, self._verified_forgetting)
        return state._replace(leads=leads, errors=sums)

    def _past(self, outputs: Array) -> Array:
        """A past (n_y, past_outputs + 1) in which nothing has changed."""
        return np.tile(self.filled(outputs)[:, None], self.options.past_outputs + 1)


@njit(cache=True, nogil=True)
def _bounds(seen):  # type: ignore[no-untyped-def]
    """(n_y, 2): what no forecast goes beyond [degC], of outputs that were `seen` (n_y, 2)."""
    bounds = np.empty_like(seen)
    for i in range(len(seen)):
        beyond = _BEYOND + _BEYOND_SHARE * (seen[i, 1] - seen[i, 0])
        bounds[i] = seen[i, 0] - beyond, seen[i, 1] + beyond
    return bounds


@njit(cache=True, nogil=True)
def _residual_sd(residual):  # type: ignore[no-untyped-def]
    """Standard deviations (n_y,) [K] of the residuals of one step, from `residual` (n_y, 2)."""
    return np.maximum(np.sqrt(residual[:, 0] / residual[:, 1]), _LEAST_SD)


@njit(cache=True, nogil=True)
def _theory(residual, spread):  # type: ignore[no-untyped-def]
    """Standard deviation (n_y,) [K] at a state's time, if residuals were independent."""
    return _residual_sd(residual) * np.sqrt(np.minimum(np.maximum(spread, 1e-6), _WIDEST_SPREAD))


@njit(cache=True, nogil=True)
def _assimilate(state, regressors, sds, outputs, memory):  # type: ignore[no-untyped-def]
    """The log likelihood of `outputs` (n_y,), from which `state` learns in place; `memory` is what a step leaves of
    what was learned and of residuals, and the variance of the prior."""
    forgetting, residual_forgetting, most = memory
    log_likelihood = 0.0
    for i in range(len(outputs)):
        if np.isnan(outputs[i]):
            continue
        error = outputs[i] - state.outputs[i, 0]
        log_likelihood -= 0.5 * (error / sds[i]) ** 2 + np.log(sds[i] * np.sqrt(2.0 * np.pi))
        # What the regression explains is the step from the last measurement; a forecast of a forecast is none.
        if state.spread[i] == 1.0:
            row = _row(state.outputs[i, 1:], regressors)
            _learn(state.coefficients[i], state.covariance[i], row, error, forgetting, most)
            state.residual[i, 0] = state.residual[i, 0] * residual_forgetting + error * error
            state.residual[i, 1] = state.residual[i, 1] * residual_forgetting + 1.0
        state.outputs[i, 0], state.echo[i], state.spread[i] = outputs[i], 0.0, 0.0
        state.seen[i] = min(state.seen[i, 0], outputs[i]), max(state.seen[i, 1], outputs[i])
    return log_likelihood


@njit(cache=True, nogil=True)
def _verify(leads, sums, lead, errors, forgetting):  # type: ignore[no-untyped-def]
    """The sums (L, n_y, 2) at `leads` (L,) with the `errors` (n_y,) of a forecast, in place."""
    for place in range(len(leads)):
        if leads[place] == lead or leads[place] == 0.0:
            for i in range(len(errors)):
                if not np.isnan(errors[i]):
                    leads[place] = lead
                    sums[place, i, 0] = forgetting * sums[place, i, 0] + errors[i] * errors[i]
                    sums[place, i, 1] = forgetting * sums[place, i, 1] + 1.0
            return


@njit(cache=True, nogil=True)
def _spread(spreads, unit, errors, leads):  # type: ignore[no-untyped-def]
    """`spreads` (h + 1, n_y) in squares of residuals `unit` (n_y,) become standard deviations [K], in place: those of
    the regression give way to what forecasts of such a lead have missed by, as far as any were verified."""
    order = np.argsort(leads)
    order = order[leads[order] > 0.0]
    for i in range(len(unit)):
        # A power of the lead between two that were verified, and from one step to the first of them.
        begin, weight, root = 0.0, 0.0, math.log(unit[i])
        end, next_weight, next_root, n = begin, weight, root, -1
        for k in range(len(spreads)):
            theory, ahead = unit[i] * math.sqrt(min(max(spreads[k, i], 1e-6), _WIDEST_SPREAD)), math.log(k + 1.0)
            while n < len(order) - 1 and (n < 0 or end <= ahead):
                n += 1
                begin, weight, root = end, next_weight, next_root
                next_weight, end = errors[order[n], i, 1], math.log(leads[order[n]])
                next_root = math.log(max(math.sqrt(errors[order[n], i, 0] / max(next_weight, 1e-9)), 1e-6))
            share = min((ahead - begin) / (end - begin), 1.0) if end > begin else 0.0
            own, missed = weight + share * (next_weight - weight), math.exp(root + share * (next_root - root))
            spreads[k, i] = math.sqrt((_SURE * theory * theory + own * missed * missed) / (_SURE + own))


@njit(cache=True, nogil=True)
def _row(past, inputs):  # type: ignore[no-untyped-def]
    """Regressors (p,): 1, past outputs from LEVEL, scaled inputs."""
    row = np.empty(1 + past.shape[0] + inputs.shape[0])
    row[0] = 1.0
    for k in range(past.shape[0]):
        row[1 + k] = past[k] - LEVEL
    for k in range(inputs.shape[0]):
        row[1 + past.shape[0] + k] = inputs[k]
    return row


@njit(cache=True, nogil=True)
def _move(coefficients, outputs, inputs, echo, spread, bounds):  # type: ignore[no-untyped-def]
    """Outputs, echo and spread one step on, in place."""
    past = echo.shape[1]
    for i in range(outputs.shape[0]):
        row = _row(outputs[i, :past], inputs)
        value = LEVEL + np.sum(row * coefficients[i])
        share = 1.0 if spread[i] == 0.0 else np.sum(coefficients[i, 1 : 1 + past] * echo[i])
        for k in range(past, 0, -1):
            outputs[i, k] = outputs[i, k - 1]
        for k in range(past - 1, 0, -1):
            echo[i, k] = echo[i, k - 1]
        outputs[i, 0] = min(max(value, bounds[i, 0]), bounds[i, 1])
        # An unstable regression, of which few samples may think well, must not grow beyond all numbers.
        echo[i, 0] = min(max(share, -1e3), 1e3)
        spread[i] += echo[i, 0] ** 2


@njit(cache=True, nogil=True)
def _moved(coefficients, outputs, inputs, past_inputs, echo, spread, bounds):  # type: ignore[no-untyped-def]
    """Outputs and spreads (h + 1, n_y): as they are, and step by step under scaled `inputs` (newest first, n_u)."""
    outputs, echo, spread = outputs.copy(), echo.copy(), spread.copy()
    steps = inputs.shape[0] - past_inputs
    means, spreads = np.empty((steps + 1, outputs.shape[0])), np.empty((steps + 1, outputs.shape[0]))
    for ahead in range(steps + 1):
        if ahead > 0:
            first = steps - ahead
            _move(coefficients, outputs, inputs[first : first + past_inputs].ravel(), echo, spread, bounds)
        for i in range(outputs.shape[0]):
            means[ahead, i], spreads[ahead, i] = outputs[i, 0], spread[i]
    return means, spreads


@njit(cache=True, nogil=True)
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
