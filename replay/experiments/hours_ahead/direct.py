"""Direct regressions, what a practitioner tries first: for each horizon one regression of the change until then.

The regressors of a forecast h steps ahead after row k: y(k), its changes over a step, 1 h and 6 h, y 24 h before the
target; the means of every input over [k, k+h), over the last 1 h and 3 h of that, and over the last 1, 6 and 24 h
before k; sine and cosine of the target's hour (UTC). Fitted anew every day to all that is known by then. The spread is
that of its own errors that have come true in the last week.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.verification.scores import gaussian_crps
from replay.errors import ReplayError
from replay.experiments.hours_ahead.forecasts import WIDE, PlainRun, issued, last_measured, no_forecasts
from replay.experiments.jobs import Arrays
from replay.experiments.series.filtering import Series
from replay.localtime import DAY, HOUR

RIDGE, BLIND, BOOSTING = "ridge", "ridge-blind", "boosting"
DIRECT = (RIDGE, BLIND, BOOSTING)
"""A ridge regression; the same without the inputs to come; gradient boosting (LightGBM)."""

_PENALTY = 10.0
"""On the squared coefficients of standardised regressors, against a sum of squared errors in K2."""
_PER_REGRESSOR = 3
"""Forecasts that have come true for each regressor, and a day of them at least, before anything is fitted."""
_MEMORY = 7 * DAY
_ROUNDS = 100
_TREES: Mapping[str, Any] = {
    "objective": "l2",
    "learning_rate": 0.1,
    "num_leaves": 15,
    "min_data_in_leaf": 20,
    "num_threads": 1,
    "deterministic": True,
    "force_row_wise": True,
    "verbosity": -1,
}

Predict = Callable[[Array], Array]


def run_direct(run: PlainRun) -> Arrays:
    series, made = run.series, no_forecasts(len(run.series.times), len(run.leads))
    a_day = max(1, round(DAY / run.period))
    for place, lead in enumerate(run.leads):
        origin = np.arange(len(series.times) - lead)
        segment = np.cumsum(series.starts)
        origin = origin[segment[origin] == segment[origin + lead]]
        mean, sd = _forecast(run, origin, lead, a_day)
        kept = np.isin(origin, issued(series, run.period, lead))
        target = origin[kept] + lead
        mean, sd = mean[kept], sd[kept]
        made.mean[target, place], made.crps[target, place] = mean, gaussian_crps(mean, sd, series.outputs[target, 0])
        made.lower[target, place], made.upper[target, place] = mean - WIDE * sd, mean + WIDE * sd
    return made._asdict()


def regressors(series: Series, period: float, origin: Array, lead: int, blind: bool) -> Array:
    """(n, F) for forecasts `lead` steps ahead after the rows `origin` (n,); without inputs to come if `blind`. Across a
    gap, what stood before it counts as what was just before."""
    y = last_measured(series.outputs[:, 0])
    summed = np.concatenate([np.zeros((1, series.inputs.shape[1])), np.cumsum(series.inputs, axis=0)])

    def ago(seconds: float) -> Array:
        return np.maximum(0, origin - max(1, round(seconds / period)))

    def mean(begin: Array, end: Array) -> Array:
        end = np.maximum(end, begin + 1)
        return np.asarray((summed[end] - summed[begin]) / (end - begin)[:, None])

    target, now = origin + lead, y[origin]
    columns = [now, *(now - y[ago(seconds)] for seconds in (period, HOUR, 6 * HOUR))]
    columns.append(y[np.clip(target - round(DAY / period), 0, origin)])
    if not blind:
        for last in (lead * period, HOUR, 3 * HOUR):
            columns += [*mean(np.maximum(origin, target - max(1, round(last / period))), target).T]
    for last in (HOUR, 6 * HOUR, DAY):
        columns += [*mean(ago(last), origin).T]
    angle = 2 * np.pi * ((series.times[origin] + lead * period) % DAY) / DAY
    return np.column_stack([*columns, np.sin(angle), np.cos(angle)])


def _forecast(run: PlainRun, origin: Array, lead: int, a_day: int) -> tuple[Array, Array]:
    """Mean and standard deviation (n,) of the forecasts after `origin` (n,)."""
    y = run.series.outputs[:, 0]
    now = last_measured(y)[origin]
    change = y[origin + lead] - now
    x = regressors(run.series, run.period, origin, lead, run.name == BLIND)
    fit = _boosted if run.name == BOOSTING else _ridge
    mean = now.copy()
    for begin in range(a_day, len(run.series.times), a_day):
        known = (origin + lead <= begin) & np.isfinite(change)
        due = (origin >= begin) & (origin < begin + a_day)
        if known.sum() >= max(a_day, _PER_REGRESSOR * x.shape[1]) and due.any():
            mean[due] = now[due] + fit(x[known], change[known], run.seed)(x[due])
    return mean, _spread(origin, lead, y[origin + lead] - mean, len(y), max(1, round(_MEMORY / run.period)))


def _spread(origin: Array, lead: int, errors: Array, rows: int, memory: int) -> Array:
    """(n,): rms of the `errors` (n,) that have come true in the `memory` rows before each forecast; 1 K before."""
    squares, counts = np.zeros(rows + 1), np.zeros(rows + 1)
    known = np.isfinite(errors)
    squares[origin[known] + lead + 1] = errors[known] ** 2
    counts[origin[known] + lead + 1] = 1.0
    squares, counts = np.cumsum(squares), np.cumsum(counts)
    until, since = origin + 1, np.maximum(0, origin + 1 - memory)
    found = counts[until] - counts[since]
    rms = np.sqrt((squares[until] - squares[since]) / np.maximum(found, 1.0))
    return np.where(found >= 2, np.maximum(rms, 1e-3), 1.0)


def _ridge(x: Array, change: Array, seed: int) -> Predict:
    centre, scale = x.mean(axis=0), x.std(axis=0)
    # A regressor that has not moved yet has nothing to say.
    weight = np.where(scale > 1e-9, 1.0 / np.maximum(scale, 1e-9), 0.0)
    z, level = (x - centre) * weight, change.mean()
    coefficients = np.linalg.solve(z.T @ z + _PENALTY * np.eye(x.shape[1]), z.T @ (change - level))
    return lambda new: np.asarray(level + ((new - centre) * weight) @ coefficients)


def _boosted(x: Array, change: Array, seed: int) -> Predict:
    library = lightgbm()
    booster = library.train({**_TREES, "seed": seed}, library.Dataset(x, change), _ROUNDS)
    return lambda new: np.asarray(booster.predict(new))


def lightgbm() -> Any:
    """The library; ReplayError where it is not installed."""
    try:
        import lightgbm
    except ImportError:
        raise ReplayError("boosting needs LightGBM, which is not installed; install the extra 'lab'") from None
    return lightgbm
