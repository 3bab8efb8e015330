"""What the models without physics have in common: Gaussian forecasts, states of arrays, and no building to tell of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from scipy.special import ndtri

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.types import Mixture, Outcome, ParameterSummary, Posterior

LEVEL = 20.0
"""degC that temperatures count from."""
FARTHEST = 15.0
"""K from its forecast beyond which a sample, if 10 standard deviations away too, is not explained."""
_SCALE = {"degC": 10.0, "W": 1000.0, "W/m2": 100.0}
"""What a channel of this unit varies by: inputs are divided by it, so that one prior suits all."""


class Regression:
    """A model of one zone that knows nothing of heat, without the moves. See `estimator.types.Estimator`."""

    physical = False
    verifies_itself = False
    forecast_draws = 1
    blocks: tuple[str, ...] = ()
    state_type: ClassVar[type[Any]]
    """The NamedTuple of arrays that is its state."""

    def __init__(self, network: Network, period: float) -> None:
        self.network = network.validate()
        self.period = period
        units = [network.channel_unit(channel) for channel in network.inputs]
        self._scale = np.array([_SCALE.get(unit, 1.0) for unit in units])
        """(n_u,): what every input varies by."""
        self.level = np.array([LEVEL * (unit == "degC") for unit in units])
        """(n_u,): what it counts from."""

    @property
    def issue_type(self) -> type[Any]:
        """The model's state."""
        return self.state_type

    def quantiles(self, mixture: Mixture, levels: Array, output: int) -> Array:
        """Gaussian quantiles (L,) of one output."""
        return np.asarray(mixture.means[output, 0] + mixture.sds[output, 0] * ndtri(levels), dtype=np.float64)

    def issue(self, state: Any, count: int) -> Any:
        """The state itself: one forecast."""
        return state

    def verified(self, state: Any, lead: int, errors: Array) -> Any:
        """The state itself."""
        return state

    def parameters(self, state: Any, levels: Array) -> ParameterSummary:
        """Not a number throughout: the model has no parameters of a building."""
        return ParameterSummary.unknown(self.network, levels)

    def draws(self, state: Any, count: int) -> None:
        """None: the model has no physics."""

    def member_weights(self, state: Any) -> Mapping[str, Array]:
        """None: there are no members."""
        return {}

    def pack(self, state: Any) -> dict[str, Array]:
        """The arrays of a state, by name."""
        packed: dict[str, Array] = state._asdict()
        return packed

    def unpack(self, arrays: Mapping[str, Array]) -> Any:
        """The state of packed arrays."""
        return self.state_type(**arrays)

    def filled(self, outputs: Array) -> Array:
        """`outputs` (n_y,) with the mean of the others in place of a missing one."""
        first = float(np.nanmean(outputs)) if np.isfinite(outputs).any() else LEVEL
        return np.where(np.isnan(outputs), first, outputs)

    def _scaled(self, inputs: Array) -> Array:
        """Inputs (..., n_u) as regressors."""
        return np.asarray((inputs - self.level) / self._scale)

    def _posterior(self, state: Any, outcome: Outcome, log_likelihood: float = float("nan")) -> Posterior:
        nothing = np.full(len(self.network.parameters), np.nan)
        return Posterior(state=state, outcome=outcome, log_likelihood=log_likelihood, parameters=nothing)
