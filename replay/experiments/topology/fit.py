"""Fit of one candidate network to a recording, and what its open-loop residuals say (paper 4.3.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.offline.least_squares import Segment, fit_open_loop
from estimator.offline.open_loop import OpenLoop
from replay.experiments.jobs import Arrays
from replay.experiments.series.following import follow, frozen, simulate
from replay.experiments.series.recorded_zone import ZoneRecord
from replay.localtime import HOUR
from replay.scores.intervals import rmse
from replay.scores.residuals import residual_autocorrelation, residual_cross_correlation
from replay.scores.windows import Window, daily_windows

SHORTEST = 12 * HOUR
"""A stretch shorter than this [s] says more of where its hidden nodes start than of the building."""
KNOWN = 2 / 3
"""Share of the rows from which the parameters for the held-out rest are fitted."""
LAG_HORIZON = 6 * HOUR
NIGHT, DAY = (20.0, 6.0), (7.0, 17.0)
"""Local hours of the paper's windows."""


class TopologyRun(NamedTuple):
    """A fit as data: the pieces of a recording for `network`, and the same cut at the held-out rest. `period` in s."""

    network: Network
    period: float
    whole: Sequence[Segment]
    known: Sequence[Segment]
    rest: Sequence[Segment]
    starts: int
    """Of the fit to the whole; half as many for the known part."""


class TopologyScores(NamedTuple):
    """K; NaN where the recording has no such window or no held-out rest."""

    train_rmse: float
    full_mae: float
    night_mae: float
    day_mae: float
    held_out_rmse: float
    j_acf: float
    j_acf_last: float
    """Its last term alone, the squared autocorrelation at LAG_HORIZON."""
    j_xcorr: Mapping[str, float]
    """By input channel of the recording, those that the network does not use included."""
    nights: int
    days: int


def fit(run: TopologyRun) -> Arrays:
    """Fit to the whole, then to the known part alone, whose parameters are tried on the rest: arrays `theta`
    (n_theta,), `initial_states` (n_pieces, n_x), `at_bound` (names) and `held_out_rmse`.

    On the rest only the temperatures of the hidden nodes at the beginning are fitted: nobody could know them.
    """
    best = fit_open_loop(run.network, run.period, run.whole, starts=run.starts)
    held_out = np.nan
    if run.known and run.rest:
        part = fit_open_loop(run.network, run.period, run.known, starts=max(1, run.starts // 2))
        held_out = fit_open_loop(frozen(run.network, part.theta), run.period, run.rest, starts=1).rmse
    return {
        "theta": best.theta,
        "initial_states": best.initial_states,
        "at_bound": np.array(best.at_bound, dtype=np.str_),
        "held_out_rmse": np.array(held_out),
    }


def segments(record: ZoneRecord, windows: Sequence[Window], network: Network) -> list[Segment]:
    """The rows of `windows` as `network` takes them."""
    inputs, outputs = record.matrix(network.inputs), record.matrix(network.measured)
    return [Segment(inputs[begin:end], outputs[begin:end]) for begin, end in windows]


def split(record: ZoneRecord, windows: Sequence[Window], output: str) -> tuple[list[Window], list[Window]]:
    """`windows` cut after the share KNOWN of their rows; parts shorter than SHORTEST are left out."""
    left = int(KNOWN * sum(end - begin for begin, end in windows))
    measured = np.isfinite(record.columns[output])
    known, rest = [], []
    for begin, end in windows:
        cut = begin + min(max(left, 0), end - begin)
        left -= end - begin
        later = np.flatnonzero(measured[cut:end])
        known.append(Window(begin, cut))
        rest.append(Window(int(cut + later[0]), end) if len(later) else Window(end, end))
    shortest = SHORTEST / record.period
    return [w for w in known if w.end - w.begin >= shortest], [w for w in rest if w.end - w.begin >= shortest]


def score(
    network: Network, record: ZoneRecord, windows: Sequence[Window], fitted: Arrays, time_zone: str
) -> TopologyScores:
    """The figures of Table 3 for the first measured node, with a held-out one beside them."""
    residual = open_loop_residual(network, record, windows, fitted)
    night = _restarted(network, record, windows, fitted, time_zone, NIGHT)
    day = _restarted(network, record, windows, fitted, time_zone, DAY)
    grid = on_grid(record, residual)
    lags = int(LAG_HORIZON // record.period)
    outputs = set(network.measured)
    return TopologyScores(
        train_rmse=rmse(residual),
        full_mae=float(np.nanmean(np.abs(residual))),
        night_mae=float(np.mean(night)) if night else np.nan,
        day_mae=float(np.mean(day)) if day else np.nan,
        held_out_rmse=float(fitted["held_out_rmse"]),
        j_acf=residual_autocorrelation(grid, lags),
        j_acf_last=residual_autocorrelation(grid, lags, first=lags),
        j_xcorr={
            channel: residual_cross_correlation(grid, on_grid(record, values), lags)
            for channel, values in record.columns.items()
            if channel not in outputs
        },
        nights=len(night),
        days=len(day),
    )


def open_loop_residual(network: Network, record: ZoneRecord, windows: Sequence[Window], fitted: Arrays) -> Array:
    """Simulated minus measured (K,) [K]; NaN outside `windows`, at their first rows, and where nothing was measured."""
    output = network.measured[0]
    states = simulate(network, record.period, record.columns, windows, fitted["theta"], fitted["initial_states"])
    residual: Array = states[:, network.nodes.index(output)] - record.columns[output]
    residual[[begin for begin, _ in windows]] = np.nan
    return residual


def _restarted(
    network: Network,
    record: ZoneRecord,
    windows: Sequence[Window],
    fitted: Arrays,
    time_zone: str,
    hours: tuple[float, float],
) -> list[float]:
    """Mean absolute error [K] of each window of local `hours` in `windows`, restarted at its first sample from
    the temperatures that follow the measurements."""
    theta = fitted["theta"]
    loop, inputs, outputs = (
        OpenLoop(network, record.period),
        record.matrix(network.inputs),
        record.matrix(network.measured),
    )
    measured = outputs[:, 0]
    found = []
    for begin, end in windows:
        states = follow(network, theta, record.period, outputs[begin:end], inputs[begin:end])
        for window in daily_windows(record.times[begin:end], record.period, time_zone, *hours):
            rows = slice(window.begin + begin, window.end + begin)
            error = np.abs(loop.simulate(theta, states[window.begin], inputs[rows]).outputs[:, 0] - measured[rows])[1:]
            if np.isfinite(measured[rows.start]) and np.isfinite(error).any():
                found.append(float(np.nanmean(error)))
    return found


def on_grid(record: ZoneRecord, values: Array) -> Array:
    """`values` (K,) with NaN in the rows that the record leaves out, so that a lag is a time."""
    places = (record.times - record.times[0]) // record.period
    grid = np.full(int(places[-1]) + 1, np.nan)
    grid[places] = values
    return grid
