"""The figures of a run: scores of its forecasts, and what it has learned against what a simulator knows."""

from collections.abc import Iterator

import numpy as np

from estimator.arrays import Array
from replay.experiments.hours_ahead.forecasts import LATER, Forecasts, leads_of, windows_of
from replay.experiments.hours_ahead.recordings import Known, Recording
from replay.experiments.jobs import Arrays
from replay.experiments.study import Figures
from replay.localtime import DAY, Seconds
from replay.scores.intervals import interval_scores, rmse
from replay.scores.windows import Window

CRPS, COVERAGE, RMSE, WIDTH, WINKLER, LARGEST, COUNT = (
    *("CRPS, K", "coverage", "RMSE, K", "width, K", "Winkler, K"),
    *("largest error, K", "forecasts scored"),
)
SCORES = (COUNT, RMSE, CRPS, COVERAGE, WIDTH, WINKLER, LARGEST)

LEARNING = 21 * DAY
"""Time [s] after which what was learned is scored."""
LOSS, GAIN, GAIN_COVERAGE = LEARNED = (
    *("heat loss over the true one", "rms error of the gain over its rms", "coverage of the gain's 95 % interval"),
)


def key(score: str, horizon: str, window: str = LATER) -> str:
    return f"{score}, {horizon}, {window}"


def figures(recording: Recording, arrays: Arrays) -> Figures:
    found: dict[str, float] = {}
    forecasts = Forecasts(*(arrays[name] for name in Forecasts._fields))
    y, leads = recording.series.outputs[:, 0], leads_of(recording.period)
    for window, rows in windows_of(recording.series).items():
        for place, (horizon, lead) in enumerate(leads.items()):
            for name, value in _scores(y, forecasts, place, Window(rows.begin + lead, rows.end)):
                found[key(name, horizon, window)] = value
    if "seconds" in arrays:
        found["seconds"] = float(arrays["seconds"])
    if recording.known is not None and "gain" in arrays:
        found |= learned(recording.known, recording.series.times, arrays)
    return found


def _scores(y: Array, forecasts: Forecasts, place: int, window: Window) -> Iterator[tuple[str, float]]:
    """Of the forecasts for the rows of `window`; nothing where there is none."""
    mean, lower, upper, crps = (values[window.begin : window.end, place] for values in forecasts)
    errors = mean - y[window.begin : window.end]
    known = np.isfinite(errors)
    if known.any():
        intervals = interval_scores(y[window.begin : window.end], lower, upper)
        yield COUNT, float(known.sum())
        yield RMSE, rmse(errors)
        yield CRPS, float(np.nanmean(crps))
        yield LARGEST, float(np.abs(errors[known]).max())
        if intervals.samples:
            yield COVERAGE, intervals.coverage
            yield WIDTH, intervals.width
            yield WINKLER, intervals.winkler


def learned(known: Known, times: Seconds, arrays: Arrays) -> Figures:
    """What a run with `arrays` (see `run_hours`) over samples at `times` (K,) knew after LEARNING of what is `known`,
    as far as that goes. The error of the gain is its rms over the rms of the true gain."""
    since = times - times[0]
    later = since >= LEARNING
    gain, truth = arrays["gain"][later], known.gain[later]
    lower, middle, upper = gain.T
    reached = arrays["heat_loss"][since[arrays["heat_loss_rows"]] >= LEARNING]
    found = {LOSS: float(reached[0]) / known.heat_loss} if len(reached) else {}
    if len(middle) and np.isfinite(middle).all():
        found[GAIN] = float(np.sqrt(np.mean((middle - truth) ** 2) / np.mean(truth**2)))
        found[GAIN_COVERAGE] = float(((lower <= truth) & (truth <= upper)).mean())
    return found
