"""Open-loop accuracy of frozen parameters on the nights of a zone (paper 4.3.7, Table 8), as part of a run. Every model
starts a night from the state of a Kalman filter with the frozen parameters, run over the day before: so none gains by
states of its own, and least squares, which has none, takes part."""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.offline.open_loop import simulate_open_loop
from replay.experiments.jobs import Arrays
from replay.experiments.series.filtering import FilterRun, Series, run_filter
from replay.experiments.series.following import follow
from replay.experiments.series.least_squares import LeastSquaresRun, fit
from replay.localtime import DAY
from replay.scores.intervals import rmse
from replay.scores.windows import Window, daily_windows
from replay.simulated.ecolar import ZONE

NIGHT = (20.0, 6.0)
"""Local hours."""
DAYTIME = (7.0, 16.0)


class NightRun(NamedTuple):
    """A run, and the samples of its nights."""

    run: FilterRun | LeastSquaresRun
    series: Series


def score_nights(job: NightRun) -> Arrays:
    """The arrays of its filter or fit, and `nights_final` and `nights_evening` [K] (n_nights,), with the parameters
    after the whole period, and with those learned by the night's beginning."""
    run, series = job.run, job.series
    windows = daily_windows(series.times, run.period, ZONE, *NIGHT)
    if isinstance(run, FilterRun):
        arrays = run_filter(run)
        final = arrays["theta"][-1]
        by_evening = [arrays["theta"][window.begin] for window in windows]
    else:
        arrays = fit(run)
        final = arrays["theta"]
        by_evening = []

    def error(theta: Array, night: Window) -> float:
        rows = slice(*night)
        state = state_at(run.network, theta, run.period, series, night.begin)
        simulated = simulate_open_loop(run.network, theta, state, series.inputs[rows], run.period)
        return rmse((simulated - series.outputs[rows])[1:, 0])

    return arrays | {
        "nights_final": np.array([error(final, window) for window in windows]),
        "nights_evening": np.array([error(theta, window) for theta, window in zip(by_evening, windows, strict=False)]),
    }


def state_at(network: Network, theta: Array, period: float, series: Series, row: int) -> Array:
    """State (n_x,) at `row` that has followed up to a day of the segment before it with `theta` (n_theta,)."""
    begins = np.flatnonzero(series.starts[: row + 1])
    rows = slice(max(int(begins[-1]), row - int(DAY // period)), row + 1)
    return np.asarray(follow(network, theta, period, series.outputs[rows], series.inputs[rows])[-1])
