"""Open-loop and one-step figures on measured buildings, the same for every way of finding the parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.offline.least_squares import Segment, fit_open_loop
from estimator.offline.open_loop import simulate_open_loop
from replay.experiments.series.filtering import Trace
from replay.experiments.series.following import follow, frozen
from replay.lab.experiments.peers.data import ARMADILLO_PUBLISHED, Case
from replay.scores import LEVEL, IntervalScores, interval_scores, rmse
from replay.scores.windows import Window


class OpenLoopScores(NamedTuple):
    """K, first rows left out; NaN without a test part. `simulated` (K,) runs through both parts, restarted between."""

    train_rmse: float
    train_mae: float
    test_rmse: float
    test_mae: float
    simulated: Array


class OneStepScores(NamedTuple):
    """`one_step`: the forecast that stood before y_k was seen, against y_k."""

    rmse: float
    intervals: IntervalScores | None


def train_segment(case: Case) -> Segment:
    """What parameters are fitted to."""
    return Segment(case.series.inputs[: case.train], case.series.outputs[: case.train])


def open_loop(case: Case, theta: Array, starts: Array | None = None) -> OpenLoopScores:
    """Simulate `theta` (n_theta,) through the train part from `starts` (n_x,), and through the test part.

    Without `starts` the temperatures of the hidden nodes at the beginning are fitted to the train part. The test part
    begins at its first measurement, hidden nodes where they are after following the measurements of the train part.
    """
    if starts is None:
        starts = fit_open_loop(
            frozen(case.network, theta), case.period, [train_segment(case)], starts=1
        ).initial_states[0]
    inputs, measured = case.series.inputs, case.series.outputs[:, 0]
    simulated = np.full(len(measured), np.nan)
    simulated[: case.train] = simulate_open_loop(case.network, theta, starts, inputs[: case.train], case.period)[:, 0]
    if case.test:
        whole = [Window(0, len(measured))]
        states = follow(case.network, case.period, case.columns, whole, theta, starts[None])
        ahead = simulate_open_loop(case.network, theta, states[case.train], inputs[case.train :], case.period)
        simulated[case.train :] = ahead[:, 0]
    error = simulated - measured
    error[[0, case.train] if case.test else [0]] = np.nan
    train, test = error[: case.train], error[case.train :]
    return OpenLoopScores(rmse(train), _mae(train), rmse(test), _mae(test), simulated)


def scored_rows(case: Case) -> slice:
    """The rows of one-step scores: the test part, or all after the first day where there is none."""
    return slice(case.train if case.test else 86_400 // case.period, None)


def one_step(case: Case, trace: Trace) -> OneStepScores:
    """Of an online estimator, which goes on learning as it would in the daemon."""
    rows = scored_rows(case)
    y = case.series.outputs[rows, 0]
    return OneStepScores(rmse(trace.mean[rows] - y), interval_scores(y, trace.lower[rows], trace.upper[rows], LEVEL))


def persistence(case: Case) -> OneStepScores:
    """The forecast that nothing changes, below which a model must stay to be of use."""
    rows = scored_rows(case)
    return OneStepScores(rmse(np.diff(case.series.outputs[:, 0])[rows.start - 1 :]), None)


def published_parameters(case: Case) -> dict[str, OpenLoopScores]:
    """The published parameters of the armadillo house in our simulation, by how inputs run between samples."""
    theta = np.array([ARMADILLO_PUBLISHED[parameter.name] for parameter in case.network.parameters])
    start = np.full(len(case.network.nodes), case.series.outputs[0, 0])
    held = open_loop(case, theta, start)
    fine = 30
    grid = np.arange(fine * (case.train - 1) + 1) / fine
    inputs = np.column_stack([np.interp(grid, np.arange(case.train), column) for column in case.series.inputs.T])
    # A step of the fine grid is held at its middle, so that the ramp between two samples is followed.
    inputs[:-1] = (inputs[1:] + inputs[:-1]) / 2
    linear = simulate_open_loop(case.network, theta, start, inputs, case.period / fine)[::fine, 0]
    error = (linear - case.series.outputs[:, 0])[1:]
    return {
        "held, as in the daemon": held,
        "linear, as in their simulation": OpenLoopScores(rmse(error), _mae(error), np.nan, np.nan, linear),
    }


def _mae(error: Array) -> float:
    kept = error[~np.isnan(error)]
    return float(np.abs(kept).mean()) if kept.size else float("nan")
