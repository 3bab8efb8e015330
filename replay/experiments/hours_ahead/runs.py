"""An estimator over a recording, as a run: its forecasts of the next step and of the hours ahead."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from estimator.bank.bank import answering_plan
from estimator.network.assembly import assemble
from estimator.network.discretise import heat_loss
from estimator.network.network import Network
from estimator.types import Estimator, Mixture
from estimator.verification.scores import crps
from replay.experiments.hours_ahead.forecasts import issued, no_forecasts
from replay.experiments.jobs import Arrays
from replay.experiments.series.filtering import TAILS, FilterRun, built, steps
from replay.localtime import DAY

SAMPLES = 200
"""What a filter's particles are reduced to before a fan is unfolded (`Estimator.issue`)."""
_LEVELS = np.array([0.025, 0.5, 0.975])

PLANNED = "planned"
"""A bank whose hours ahead are those with which it answers a plan of heating, of that which followed."""


def run_hours(run: FilterRun) -> Arrays:
    """The arrays of `Forecasts` (K, H) at the leads of `run`, and of what is learned the .025, .5 and .975 quantiles
    `gain` (K, 3) [W]; `heat_loss` (D,) of the median parameters to the first boundary [W/K], once a day at
    `heat_loss_rows` (D,); `seconds` ()."""
    return _run(run, lambda _, state: state)


def run_planned(run: FilterRun) -> Arrays:
    """The same of PLANNED."""
    return _run(run, answering_plan)


def _run(run: FilterRun, asked: Callable[[Estimator, Any], Any]) -> Arrays:
    began = time.perf_counter()
    estimator, known, _ = built(run)
    series, rows = run.series, len(run.series.times)
    drive = series.inputs if known is None else known.drive(series.times.astype(np.float64), series.inputs)
    kept, gain = no_forecasts(rows, len(run.leads)), np.full((rows, 3), np.nan)
    losses: dict[int, float] = {}
    due = {lead: set(issued(series, run.period, lead).tolist()) for lead in run.leads if lead > 1}

    def keep(row: int, place: int, mixture: Mixture) -> None:
        y = float(series.outputs[row, 0])
        kept.mean[row, place] = mixture.mean()[0]
        kept.lower[row, place], kept.upper[row, place] = mixture.quantiles(TAILS, 0)
        if np.isfinite(y):
            kept.crps[row, place] = crps(mixture, 0, y)

    for step in steps(estimator, series, run.seed, known, begun=run.experience):
        if step.standing is not None:
            keep(step.row, 0, step.standing)
        if places := {lead: place for place, lead in enumerate(run.leads) if step.row in due.get(lead, ())}:
            # What a controller would plan with, had it known the inputs: those that really followed.
            plan = drive[step.row + 1 : step.row + max(places)]
            fan = estimator.unfold(estimator.issue(asked(estimator, step.state), SAMPLES), plan)
            for lead, mixture in enumerate(fan.each(), start=1):
                if lead in places:
                    keep(step.row + lead, places[lead], mixture)
        if step.disturbance is not None:
            gain[step.row] = step.disturbance().gain
        if estimator.physical and step.row % max(1, round(DAY / run.period)) == 0:
            median = estimator.parameters(step.state, _LEVELS).parameters[:, 1]
            losses[step.row] = _to_first_boundary(estimator.network, median)
    return kept._asdict() | {
        "gain": gain,
        "heat_loss": np.array([*losses.values()], dtype=np.float64),
        "heat_loss_rows": np.array([*losses], dtype=np.int64),
        "seconds": np.array(time.perf_counter() - began),
    }


def _to_first_boundary(network: Network, theta: np.ndarray) -> float:
    """The part of the steady-state heat loss [W/K] of a model with `theta` (n_theta,) that goes to the outdoors."""
    matrices = assemble(network, theta[:, None])
    node = network.nodes.index(network.measured[0])
    share = np.linalg.solve(matrices.internal[0], matrices.inputs[0])[node, 0]
    return float(share * heat_loss(matrices, node)[0])
