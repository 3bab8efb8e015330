"""Open-loop accuracy on windows in which the model should hold (paper 4.3.7, 5.1.4): what a controller relies on."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.offline.open_loop import simulate_open_loop
from replay.localtime import DAY, HOUR, Seconds, wall_clock
from replay.scores.intervals import Mask, rmse

SHORTEST_SEGMENT = 12 * HOUR


class Window(NamedTuple):
    """Rows `begin` to before `end` of a series."""

    begin: int
    end: int


def quiet_segments(dominated: Mask, period: float, shortest: float = SHORTEST_SEGMENT) -> list[Window]:
    """Unbroken runs of steps that are not `dominated` (K,) and last at least `shortest` s (5.1.4)."""
    return [window for window in runs(~dominated) if (window.end - window.begin) * period >= shortest]


def daily_windows(times: Seconds, period: float, zone: str, begin: float, end: float) -> list[Window]:
    """Runs of rows `period` s apart that fill the local hours [begin, end) of a day of `zone`, such as 20 to 6, without
    lacking a row. `times` (K,) are UTC seconds, ascending."""
    # In whole seconds: most minutes are no exact share of an hour, and a window would lack its last row.
    second, first, last = wall_clock(times, zone) % DAY, round(begin * HOUR), round(end * HOUR)
    inside = (second >= first) & (second < last) if first < last else (second >= first) | (second < last)
    windows = []
    for window in unbroken_runs(inside, times, period):
        late, early = (second[window.begin] - first) % DAY, (last - second[window.end - 1]) % DAY
        if late < period and early <= period:
            windows.append(window)
    return windows


def open_loop_errors(
    network: Network,
    theta: Array,
    period: float,
    windows: Sequence[Window],
    initial: Array,
    inputs: Array,
    reference: Array,
) -> Array:
    """RMSE [K] of each window of the first output simulated without measurements (17), shape (len(windows),), but for
    the row where it starts. `theta` (n_theta,) is frozen; `initial` (K, n_x) are states from which a window may start,
    row k of `inputs` (K, n_u) holds over [t_k, t_(k+1)), `reference` (K,) is what the output is compared with."""
    errors = []
    for begin, end in windows:
        simulated = simulate_open_loop(network, theta, initial[begin], inputs[begin:end], period)
        errors.append(rmse(simulated[1:, 0] - reference[begin + 1 : end]))
    return np.array(errors)


def runs(mask: Mask) -> list[Window]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [Window(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]


def unbroken_runs(mask: Mask, times: Seconds, period: float) -> list[Window]:
    """Runs of rows `period` s apart, at all of which `mask` (K,) holds."""
    cuts = [0, *(np.flatnonzero(np.diff(times) != period) + 1).tolist(), len(times)]
    return [Window(cut + run.begin, cut + run.end) for cut, end in pairwise(cuts) for run in runs(mask[cut:end])]
