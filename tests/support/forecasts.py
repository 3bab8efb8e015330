"""Forecasts of a worker or of an estimator, asked directly."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from estimator.arrays import Array
from estimator.statespace.matrices import StateSpace
from estimator.statespace.simulate import Simulation
from estimator.types import Estimator, Mixture
from service.forecast.engine import FanQuestion
from service.forecast.foresight import NO_WEATHER
from service.forecast.plan import Inputs
from service.forecast.request import detail
from service.zone.worker import ZoneWorker


def asked(worker: ZoneWorker, question: Callable[..., Any]) -> Any:
    """What a worker answers where no weather is foretold and nobody gives up."""
    return question(worker, NO_WEATHER, lambda: False)


def question(steps: int, planned: Inputs | None = None, levels: Sequence[float] = (0.9,)) -> FanQuestion:
    """Asks for a forecast over `steps` steps."""
    return FanQuestion(steps, planned or {}, tuple(levels), 0, detail([steps + 1]))


def fan_of(worker: ZoneWorker, steps: int, planned: Inputs | None = None, levels: Sequence[float] = (0.9,)) -> Any:
    """The forecast of a worker over `steps` steps."""
    return asked(worker, question(steps, planned, levels))


def unfolded(estimator: Estimator, state: Any, plan: Array) -> list[Mixture]:
    """The outputs at the state's time and after each row of `plan` (h, n_u), from all of its draws."""
    return list(estimator.unfold(estimator.issue(state, estimator.forecast_draws), plan).each())


def mean_path(models: StateSpace, plan: Array) -> Array:
    """(h + 1, n_y): mean of the outputs [degC] now and after each row of `plan` (h, n_u)."""
    simulation, path = Simulation(models), []
    for inputs in plan:
        path.append(simulation.outputs())
        simulation.step(inputs)
    return np.array([*path, simulation.outputs()])


def mixture_quantile(level: float, weights: Array, means: Array, sds: Array) -> float:
    """The `level` quantile of a Gaussian mixture (all (N,)): the root of its CDF."""
    used = weights > 0
    weights, means, sds = weights[used] / weights[used].sum(), means[used], sds[used]
    reach = 9.0 * sds
    lower, upper = float((means - reach).min()), float((means + reach).max())
    return float(brentq(lambda y: weights @ ndtr((y - means) / sds) - level, lower, upper, xtol=1e-12, rtol=1e-14))
