"""Offline least squares as a run of an experiment: the static baseline beside the online estimators (3.3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator.network.network import Network
from estimator.offline.least_squares import Segment, fit_open_loop
from replay.experiments.jobs import Arrays, Job
from replay.experiments.series.filtering import Series


class LeastSquaresRun(NamedTuple):
    """What a fit depends on; `period` in s."""

    network: Network
    period: float
    segments: Sequence[Segment]
    starts: int
    seed: int


def least_squares_job(label: str, run: LeastSquaresRun) -> Job:
    """The job of `run`; its arrays are `theta` (n_theta,), `rmse` [K], `at_bound` (names), and, over segments,
    `initial_states` (n_segments, n_x)."""
    return Job(label, run.seed, fit, run)


def fit(run: LeastSquaresRun) -> Arrays:
    """The arrays of the fit."""
    result = fit_open_loop(
        run.network,
        run.period,
        run.segments,
        starts=run.starts,
        seed=run.seed,
    )
    return {
        "theta": result.theta,
        "rmse": np.array(result.rmse),
        "initial_states": result.initial_states,
        "at_bound": np.array(result.at_bound, dtype=np.str_),
    }


def segments_of(series: Series, shortest: int = 2) -> list[Segment]:
    """The unbroken stretches of `series` that have at least `shortest` samples."""
    begins = [*np.flatnonzero(series.starts).tolist(), len(series.times)]
    return [Segment(series.inputs[a:b], series.outputs[a:b]) for a, b in pairwise(begins) if b - a >= max(shortest, 2)]
