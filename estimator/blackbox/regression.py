"""What the models without physics have in common: Gaussian forecasts, states of arrays, and no building to tell of."""

from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.types import OneState, Outcome, ParameterSummary, Posterior

LEVEL = 20.0
"""degC that temperatures count from."""
FARTHEST = 15.0
"""K from its forecast beyond which a sample, if 10 standard deviations away too, is not explained."""
_SCALE = {"degC": 10.0, "W": 1000.0, "W/m2": 100.0}
"""What a channel of this unit varies by: inputs are divided by it, so that one prior suits all."""
_CLOUDS = 100.0
"""% that clouds vary by."""


def levels_and_scales(network: Network) -> tuple[Array, Array]:
    """What each input of `network` counts from, and what it varies by: (n_u,) and (n_u,)."""
    units = [network.channel_unit(channel) for channel in network.inputs]
    scales = [
        _CLOUDS if channel == network.clouds else _SCALE.get(unit, 1.0)
        for channel, unit in zip(network.inputs, units, strict=True)
    ]
    return np.array([LEVEL * (unit == "degC") for unit in units]), np.array(scales)


class Regression(OneState):
    """A model of one zone that knows nothing of heat, without the moves. See `estimator.types.Estimator`."""

    physical = False

    def __init__(self, network: Network, period: float) -> None:
        self.network = network.validate()
        self.period = period
        self._nothing = np.full(len(network.parameters), np.nan)
        self.level, self._scale = levels_and_scales(network)

    def parameters(self, state: Any, levels: Array) -> ParameterSummary:
        """Not a number throughout: the model has no parameters of a building."""
        return ParameterSummary.unknown(self.network, levels)

    def draws(self, state: Any, count: int) -> None:
        """None: the model has no physics."""

    def filled(self, outputs: Array) -> Array:
        """`outputs` (n_y,) with the mean of the others in place of a missing one."""
        first = float(np.nanmean(outputs)) if np.isfinite(outputs).any() else LEVEL
        return np.where(np.isnan(outputs), first, outputs)

    def _scaled(self, inputs: Array) -> Array:
        """Inputs (..., n_u) as regressors."""
        return np.asarray((inputs - self.level) / self._scale)

    def _posterior(self, state: Any, outcome: Outcome, log_likelihood: float = float("nan")) -> Posterior:
        return Posterior(state=state, outcome=outcome, log_likelihood=log_likelihood, parameters=self._nothing)
