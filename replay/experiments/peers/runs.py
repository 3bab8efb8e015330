"""An online estimator whose boxes lie around a least-squares fit of the train part: the two steps of commissioning."""

from __future__ import annotations

from typing import NamedTuple

from replay.experiments.jobs import Arrays, Job, Tick
from replay.experiments.series.filtering import FilterRun, run_filter
from replay.experiments.series.least_squares import STEPS_A_START, LeastSquaresRun, fit
from replay.experiments.topology.toml import proposal


class BoxedRun(NamedTuple):
    """A fit, and a run of an estimator on the same network, whose own box is that of the fit."""

    fit: LeastSquaresRun
    run: FilterRun


def boxed_job(label: str, run: BoxedRun) -> Job:
    """The job of `run`; its arrays are those of a `Trace`."""
    return Job(label, run.run.seed, run_boxed, run, run.fit.starts * STEPS_A_START + len(run.run.series.times))


def run_boxed(run: BoxedRun, tick: Tick) -> Arrays:
    """Fit, draw the boxes around what was found, and run the estimator in them."""
    fitted = fit(run.fit, tick)
    network = proposal(run.run.network, fitted["theta"], tuple(fitted["at_bound"].tolist()))
    return run_filter(run.run._replace(network=network), tick)
