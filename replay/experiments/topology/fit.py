"""Fit of one candidate network to a recording, and what its open-loop residuals say (paper 4.3.3)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.network.network import Network
from estimator.offline.least_squares import Segment, fit_open_loop
from estimator.offline.open_loop import simulate_open_loop
from replay.experiments.jobs import Arrays
from replay.experiments.series.following import follow, frozen
from replay.experiments.series.recorded_zone import ZoneRecord
from replay.localtime import HOUR
from replay.scores.intervals import rmse
from replay.scores.residuals import residual_autocorrelation
from replay.scores.windows import Window, daily_windows

SHORTEST = 12 * HOUR
"""A stretch shorter than this [s] says more of where its hidden nodes start than of the building."""
KNOWN = 2 / 3
"""Share of the rows from which the parameters for the held-out rest are fitted."""
LAG_HORIZON = 6 * HOUR
NIGHT, DAY = (20.0, 6.0), (7.0, 17.0)
"""Local hours of the paper's windows."""

TRAIN, FULL, NIGHTLY, DAILY, HELD_OUT = SCORES = (
    *("train RMSE [K]", "full MAE [K]", "night MAE [K]", "day MAE [K]", "held-out RMSE [K]"),
)
NIGHTS, DAYS = "nights", "days"
"""Figures of a fit, beside `fitted` and `at_bound` of its parameters."""


def fitted(parameter: str) -> str:
    return f"fitted {parameter}"


def at_bound(parameter: str) -> str:
    """Name of the figure that is 1 where `parameter` ended at an end of its box, and 0 elsewhere."""
    return f"at a bound: {parameter}"


class TopologyRun(NamedTuple):
    """A fit as data: the pieces of a recording for `network`, and the same cut at the held-out rest. `period` in s."""

    network: Network
    period: float
    whole: Sequence[Segment]
    known: Sequence[Segment]
    rest: Sequence[Segment]
    starts: int
    """Of the fit to the whole; half as many for the known part."""


def fit(run: TopologyRun) -> Arrays:
    """Fit to the whole, then to the known part alone, whose parameters are tried on the rest, where only the
    temperatures of hidden nodes at the beginning are fitted: arrays `theta` (n_theta,), `initial_states` (n_pieces,
    n_x), `at_bound` (n_theta,) and `held_out_rmse`."""
    best = fit_open_loop(run.network, run.period, run.whole, starts=run.starts)
    held_out = np.nan
    if run.known and run.rest:
        part = fit_open_loop(run.network, run.period, run.known, starts=max(1, run.starts // 2))
        held_out = fit_open_loop(frozen(run.network, part.theta), run.period, run.rest, starts=1).rmse
    return {
        "theta": best.theta,
        "initial_states": best.initial_states,
        "at_bound": np.array([parameter.name in best.at_bound for parameter in run.network.parameters]),
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


def figures(
    network: Network, record: ZoneRecord, windows: Sequence[Window], found: Arrays, time_zone: str
) -> dict[str, float]:
    """The figures of Table 3 for the first measured node, and those of every parameter.

    NaN where the recording has no such window or no held-out rest.
    """
    grid = np.full(int((record.times[-1] - record.times[0]) // record.period) + 1, np.nan)
    restarted: dict[str, list[float]] = {NIGHTS: [], DAYS: []}
    for (begin, end), start in zip(windows, found["initial_states"], strict=True):
        piece = record.rows(Window(begin, end))
        inputs, outputs = piece.matrix(network.inputs), piece.matrix(network.measured)
        simulated = simulate_open_loop(network, found["theta"], start, inputs, record.period)
        # With the rows that the record leaves out, so that a lag is a time.
        grid[(piece.times[1:] - record.times[0]) // record.period] = (simulated - outputs)[1:, 0]
        states = follow(network, found["theta"], record.period, outputs, inputs)
        for name, hours in ((NIGHTS, NIGHT), (DAYS, DAY)):
            for window in daily_windows(piece.times, record.period, time_zone, *hours):
                rows = slice(*window)
                again = simulate_open_loop(network, found["theta"], states[window.begin], inputs[rows], record.period)
                error = np.abs(again - outputs[rows])[1:, 0]
                if np.isfinite(outputs[window.begin, 0]) and np.isfinite(error).any():
                    restarted[name].append(float(np.nanmean(error)))
    lags = int(LAG_HORIZON // record.period)
    scores = (rmse(grid), float(np.nanmean(np.abs(grid))), *(_mean(errors) for errors in restarted.values()))
    names = [parameter.name for parameter in network.parameters]
    return {
        **dict(zip(SCORES, (*scores, float(found["held_out_rmse"])), strict=True)),
        "J_acf": residual_autocorrelation(grid, lags),
        "its term at 6 h": residual_autocorrelation(grid, lags, first=lags),
        **{name: float(len(errors)) for name, errors in restarted.items()},
        **dict(zip(map(fitted, names), found["theta"].tolist(), strict=True)),
        **dict(zip(map(at_bound, names), found["at_bound"].astype(float).tolist(), strict=True)),
    }


def _mean(errors: Sequence[float]) -> float:
    return float(np.mean(errors)) if errors else float("nan")
