"""An estimator over a recording, as a run: its forecasts of the next step and of the hours ahead."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator import registry
from estimator.arrays import Array
from estimator.heat.known import KnownHeat
from estimator.network.assembly import assemble
from estimator.network.discretise import heat_loss
from estimator.network.network import Network
from estimator.types import Estimator, Mixture
from estimator.verification.scores import crps
from replay.experiments.hours_ahead.forecasts import no_forecasts
from replay.experiments.hours_ahead.horizons import issued
from replay.experiments.jobs import Arrays
from replay.experiments.series.filtering import FilterRun, Series, Step, steps
from replay.localtime import DAY
from replay.scores.intervals import LEVEL
from service.config.fitting import known_heat

SAMPLES = 200
"""What a filter's particles are reduced to before a fan is unfolded (`Estimator.issue`)."""
_TAILS = np.array([0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
_LEVELS = np.array([0.025, 0.5, 0.975])


class HoursRun(NamedTuple):
    """A filter over a series, and the steps ahead at which its forecasts are kept."""

    filter: FilterRun
    leads: tuple[int, ...]


def run_hours(run: HoursRun) -> Arrays:
    """The arrays of `Forecasts` (K, H), and of what is learned the .025, .5 and .975 quantiles `gain` (K, 3) [W];
    `heat_loss` (D,) of the median parameters to the first boundary [W/K], once a day at `heat_loss_rows` (D,);
    `seconds` ().
    """
    began = time.perf_counter()
    name, options, network, period, series, seed, whereabouts = run.filter
    estimator = registry.build(name, network, period, options)
    known = known_heat(estimator.network, period, whereabouts)
    keeper = _Keeper(estimator, series, run.leads, known)
    for step in steps(estimator, series, seed, known):
        keeper.take(step)
        keeper.learn(step)
    return keeper.arrays() | {"seconds": np.array(time.perf_counter() - began)}


def _to_first_boundary(network: Network, theta: Array) -> float:
    """The part of the steady-state heat loss [W/K] of a model with `theta` (n_theta,) that goes to the outdoors."""
    matrices = assemble(network, theta[:, None])
    node = network.nodes.index(network.measured[0])
    share = np.linalg.solve(matrices.internal[0], matrices.inputs[0])[node, 0]
    return float(share * heat_loss(matrices, node)[0])


class _Keeper:
    """The forecasts that `estimator` makes along `series`."""

    def __init__(self, estimator: Estimator, series: Series, leads: Sequence[int], known: KnownHeat | None) -> None:
        self._estimator, self._series, self._leads = estimator, series, tuple(leads)
        self._drive = series.inputs if known is None else known.drive(series.times.astype(np.float64), series.inputs)
        self._kept = no_forecasts(len(series.times), len(leads))
        self._issued = {lead: set(issued(series, estimator.period, lead).tolist()) for lead in leads if lead > 1}
        self._a_day = max(1, round(DAY / estimator.period))
        self._gain = np.full((len(series.times), 3), np.nan)
        self._heat_loss: dict[int, float] = {}

    def take(self, step: Step) -> None:
        """Keep what stood before the sample of `step`, and what is forecast after it."""
        if step.standing is not None:
            self._keep(step.row, 0, step.standing)
        places = {lead: place for place, lead in enumerate(self._leads) if step.row in self._issued.get(lead, ())}
        if not places:
            return
        # What a controller would plan with, had it known the inputs: those that really followed.
        plan = self._drive[step.row + 1 : step.row + max(places)]
        fan = self._estimator.unfold(self._estimator.issue(step.state, SAMPLES), plan)
        for lead, mixture in enumerate(fan.each(), start=1):
            if lead in places:
                self._keep(step.row + lead, places[lead], mixture)

    def learn(self, step: Step) -> None:
        """Keep what the sample of `step` has taught."""
        if step.posterior.disturbance is not None:
            self._gain[step.row] = step.posterior.disturbance().gain
        if self._estimator.physical and step.row % self._a_day == 0:
            median = self._estimator.parameters(step.state, _LEVELS).parameters[:, 1]
            self._heat_loss[step.row] = _to_first_boundary(self._estimator.network, median)

    def arrays(self) -> Arrays:
        """The forecasts, and what was learned."""
        arrays: Arrays = self._kept._asdict()
        arrays["gain"] = self._gain
        arrays["heat_loss"] = np.array([*self._heat_loss.values()], dtype=np.float64)
        arrays["heat_loss_rows"] = np.array([*self._heat_loss], dtype=np.int64)
        return arrays

    def _keep(self, row: int, place: int, mixture: Mixture) -> None:
        kept, y = self._kept, float(self._series.outputs[row, 0])
        kept.mean[row, place] = mixture.mean()[0]
        kept.lower[row, place], kept.upper[row, place] = self._estimator.quantiles(mixture, _TAILS, 0)
        if np.isfinite(y):
            kept.crps[row, place] = crps(mixture, 0, y)
