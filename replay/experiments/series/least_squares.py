"""Offline least squares as a run of an experiment: the static baseline beside the online estimators (3.3.3)."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator.network.network import Network
from estimator.offline.least_squares import Segment, fit_open_loop
from replay.experiments.jobs import Arrays
from replay.experiments.series.filtering import Series


class LeastSquaresRun(NamedTuple):
    """What a fit depends on; `period` in s."""

    network: Network
    period: float
    segments: Sequence[Segment]
    starts: int
    seed: int


def fit(run: LeastSquaresRun) -> Arrays:
    """The fit's `theta` (n_theta,)."""
    return {"theta": fit_open_loop(run.network, run.period, run.segments, starts=run.starts, seed=run.seed).theta}


def segments_of(series: Series, shortest: int = 2) -> list[Segment]:
    """The unbroken stretches of `series` that have at least `shortest` samples."""
    begins = [*np.flatnonzero(series.starts).tolist(), len(series.times)]
    return [Segment(series.inputs[a:b], series.outputs[a:b]) for a, b in pairwise(begins) if b - a >= max(shortest, 2)]
