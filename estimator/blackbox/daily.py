"""Yesterday, corrected: the online ARX on what has changed since the same time of the day before.

A building that is run by the clock does today what it did yesterday. The differences to the day before, of output and
inputs, leave out what no input explains but every day repeats: set-backs, occupants, a sun that nothing measures.
Before the first day is over, the first sample stands for the day before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array
from estimator.blackbox.arx import ARX, ARXState
from estimator.blackbox.options import ARXOptions
from estimator.blackbox.regression import LEVEL, Regression
from estimator.network.network import Network
from estimator.types import Mixture, Mixtures, Posterior


class DailyState(NamedTuple):
    """An `ARXState` of differences, and the day of D steps that they are taken from."""

    coefficients: Array
    covariance: Array
    outputs: Array
    inputs: Array
    residual: Array
    errors: Array
    leads: Array
    echo: Array
    spread: Array
    seen: Array
    day_outputs: Array
    """(n_y, D) [degC]: of the last day, the newest last; forecasts where nothing was measured."""
    day_inputs: Array
    """(D, n_u): the same."""

    def differences(self) -> ARXState:
        """The regression's own part."""
        return ARXState(*self[: len(ARXState._fields)])

    def with_differences(self, differences: ARXState) -> DailyState:
        """With another one."""
        return self._replace(**differences._asdict())


class Daily(Regression):
    """The model of one zone. See `estimator.types.Estimator` for the moves."""

    state_type = DailyState

    def __init__(self, network: Network, period: float, options: ARXOptions) -> None:
        super().__init__(network, period)
        self.options = options
        self._arx = ARX(network, period, options)
        self._steps = max(1, round(DAY / period))

    def start(self, seed: int, outputs: Array, inputs: Array) -> DailyState:
        """Nothing has changed since yesterday: outputs (n_y,) and inputs (n_u,) of the first sample."""
        filled = self.filled(outputs)
        differences = self._arx.start(seed, np.full(len(filled), LEVEL), self.level)
        return DailyState(*differences, *self._day(filled, inputs))

    def restart(self, state: DailyState, outputs: Array, inputs: Array) -> DailyState:
        """The first sample after a gap: another day, the same regression."""
        filled = self.filled(outputs)
        differences = self._arx.restart(state.differences(), np.full(len(filled), LEVEL), self.level)
        return DailyState(*differences, *self._day(filled, inputs))

    def predict(self, state: DailyState, inputs: Array) -> DailyState:
        """One period on under `inputs` (n_u,) held over the step."""
        now = state.outputs[:, 0] - LEVEL + state.day_outputs[:, 0]
        differences = self._arx.predict(state.differences(), inputs - state.day_inputs[0] + self.level)
        return DailyState(
            *differences,
            np.concatenate([state.day_outputs[:, 1:], now[:, None]], axis=1),
            np.concatenate([state.day_inputs[1:], inputs[None]]),
        )

    def predictive(self, state: DailyState) -> Mixture:
        """A Gaussian for every output at the state's time, as a mixture of one."""
        change = self._arx.predictive(state.differences())
        return change._replace(means=change.means - LEVEL + state.day_outputs[:, :1])

    def update(self, state: DailyState, outputs: Array) -> Posterior:
        """Learn from `outputs` (n_y,), the newest of which `state` has forecast; NaN for a missing one."""
        posterior = self._arx.update(state.differences(), outputs - state.day_outputs[:, 0] + LEVEL)
        return posterior._replace(state=state.with_differences(posterior.state))

    def unfold(self, issue: DailyState, plan: Array) -> Mixtures:
        """What the issue forecasts under `plan` (h, n_u)."""
        yesterday = np.concatenate([issue.day_inputs, plan])[: len(plan)]
        changes, sds = self._arx.futures(issue.differences(), plan - yesterday + self.level)
        means = changes - LEVEL
        for first in range(0, len(means), self._steps):
            day = slice(first, first + self._steps)
            before = means[first - self._steps : first] if first else issue.day_outputs.T
            means[day] += before[: len(means[day])]
        return Mixtures.of_gaussians(means, sds)

    def verified(self, state: DailyState, lead: int, errors: Array) -> DailyState:
        """Learn from the errors (n_y,) [K] of a forecast `lead` steps ahead whose time has come; NaN where unknown."""
        return state.with_differences(self._arx.verified(state.differences(), lead, errors))

    def _day(self, outputs: Array, inputs: Array) -> tuple[Array, Array]:
        """A day in which nothing has changed."""
        return np.tile(outputs[:, None], self._steps), np.tile(inputs, (self._steps, 1))
