"""Everything the semi-synthetic experiment says of one run: an estimator, a seed, and the truth behind it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from replay.experiments.series.filtering import REGIMES, Series, Trace
from replay.localtime import DAY
from replay.scores import (
    IntervalScores,
    area_under_roc,
    by_regime,
    open_loop_errors,
    parasitic_learning_index,
    quiet_segments,
    rmse,
    transfer_errors,
    update_magnitudes,
)
from replay.scores.intervals import Mask
from replay.simulated.semi_synthetic import PERIOD, Truth

OVERALL, LOW, DOMINATED = "overall", "low-disturbance", "disturbance-dominated"
COURSE_DAYS = 2
"""Days between two looks at the transfer functions."""
ONSET = 12
"""Steps since the beginning of an event over which coverage is followed."""
SETTLING = 6
"""Steps after each beginning and end of the gain that the settled area under the ROC curve leaves out (1 h)."""


class RunScores(NamedTuple):
    """Scores of one run. RMSE in K against the noise-free temperature in both conventions."""

    one_step_rmse: float
    one_step: dict[str, IntervalScores]
    """The interval published before y_k, against y_k."""
    filtered_rmse: float
    filtered: dict[str, IntervalScores]
    """The interval of the state after y_k, against the noise-free state."""
    by_volatility: dict[str, IntervalScores]
    """`one_step`, by the volatility regime that was published together with the interval."""
    onset: Array
    """(ONSET,): `one_step` coverage in the 1st, 2nd, ... step under a gain."""
    h2: Array
    h_infinity: Array
    """(n_u,): relative errors of the final parameters, inputs in the network's order."""
    h2_course: Array
    """(days / COURSE_DAYS, n_u): the same in the course of learning."""
    update_low: float
    update_dominated: float
    """Median of d_k (33) in either regime."""
    parasitic_learning: float
    """NaN for an estimator that learns nothing."""
    update_thirds: tuple[float, ...]
    parasitic_learning_thirds: tuple[float, ...]
    """Median of d_k and the index in each third of the period."""
    auc: float
    auc_later: float
    """The same for alpha of the next sample."""
    auc_settled: float
    """The same without the SETTLING steps after each beginning and end of the gain."""
    alpha_low: float
    alpha_dominated: float
    """Median over steps of the median of alpha."""
    open_loop: Array
    """RMSE [K] of every low-disturbance segment of at least 12 h, started at the true state."""


class Fitted(NamedTuple):
    """Scores of a parameter vector that was fitted offline; names as in `RunScores`."""

    h2: Array
    h_infinity: Array
    open_loop: Array


def score_fit(network: Network, series: Series, truth: Truth, theta: Array) -> Fitted:
    """The scores of `theta` (n_theta,)."""
    errors = transfer_errors(network, theta[:, None], true_parameters(network), PERIOD)
    return Fitted(errors.h2[0, 0], errors.h_infinity[0, 0], open_loop(network, series, truth, theta))


def score(network: Network, series: Series, truth: Truth, trace: Trace) -> RunScores:
    """The scores of `trace`, which an estimator for `network` left on `series`."""
    dominated = truth.disturbance_dominated
    regimes = {OVERALL: np.ones_like(dominated), LOW: ~dominated, DOMINATED: dominated}
    published = np.concatenate([[-1], trace.regime[:-1]])
    y, indoor = series.outputs[:, 0], truth.states[:, network.nodes.index(network.measured[0])]
    magnitudes = update_magnitudes(trace.theta)
    median_alpha = trace.alpha[:, 1]
    settled = since_change(dominated) >= SETTLING
    errors = transfer_errors(network, trace.theta[-1:].T, true_parameters(network), PERIOD)
    return RunScores(
        one_step_rmse=rmse(trace.mean - indoor),
        one_step=by_regime(y, trace.lower, trace.upper, regimes),
        filtered_rmse=rmse(trace.filtered_mean - indoor),
        filtered=by_regime(indoor, trace.filtered_lower, trace.filtered_upper, regimes),
        by_volatility=by_regime(
            y, trace.lower, trace.upper, {name: published == place for place, name in enumerate(REGIMES)}
        ),
        onset=_onset_coverage(y, trace, dominated),
        h2=errors.h2[0, 0],
        h_infinity=errors.h_infinity[0, 0],
        h2_course=transfer_errors(network, course(trace.theta).T, true_parameters(network), PERIOD).h2[:, 0],
        update_low=float(np.nanmedian(magnitudes[~dominated])),
        update_dominated=float(np.nanmedian(magnitudes[dominated])) if dominated.any() else np.nan,
        parasitic_learning=_index(magnitudes, dominated),
        update_thirds=tuple(_median(part) for part in np.array_split(magnitudes, 3)),
        parasitic_learning_thirds=tuple(
            _index(*parts) for parts in zip(np.array_split(magnitudes, 3), np.array_split(dominated, 3), strict=True)
        ),
        auc=area_under_roc(median_alpha, dominated),
        auc_later=area_under_roc(median_alpha[1:], dominated[:-1]),
        auc_settled=area_under_roc(median_alpha[settled], dominated[settled]),
        alpha_low=_median(median_alpha[~dominated]),
        alpha_dominated=_median(median_alpha[dominated]),
        open_loop=open_loop(network, series, truth, trace.theta[-1]),
    )


def open_loop(network: Network, series: Series, truth: Truth, theta: Array) -> Array:
    """RMSE [K] of the noise-free temperature on every low-disturbance segment of at least 12 h, from the true state."""
    # Row k of the inputs acts after t_k, so a segment begins where the interval that ends at t_k was already quiet.
    windows = quiet_segments(truth.disturbance_dominated, PERIOD)
    indoor = truth.states[:, network.nodes.index(network.measured[0])]
    return open_loop_errors(network, theta, PERIOD, windows, truth.states, series.inputs, indoor)


def true_parameters(network: Network) -> Array:
    """theta (n_theta,) of the simulated building: its nominal values."""
    return np.array([parameter.nominal for parameter in network.parameters], dtype=np.float64)


def course(rows: Array) -> Array:
    """The last row of every COURSE_DAYS days; of less than that, the last one."""
    step = min(COURSE_DAYS * DAY // PERIOD, len(rows))
    return rows[step - 1 :: step]


def since_change(dominated: Mask) -> Array:
    """Steps (K,) since the label last changed, 0 at the change."""
    changed = np.flatnonzero(np.diff(dominated)) + 1
    step = np.arange(len(dominated))
    last = np.concatenate([[-10 * len(dominated)], changed])[np.searchsorted(changed, step, side="right")]
    return step - last


def _onset_coverage(y: Array, trace: Trace, dominated: Mask) -> Array:
    since = np.where(dominated, since_change(dominated), -1)
    steps = {str(step): since == step for step in range(ONSET)}
    return np.array([scores.coverage for scores in by_regime(y, trace.lower, trace.upper, steps).values()])


def _index(magnitudes: Array, dominated: Mask) -> float:
    """The parasitic-learning index; NaN where nothing moves."""
    return parasitic_learning_index(magnitudes, dominated) if np.nansum(magnitudes) > 0.0 else float("nan")


def _median(values: Array) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if known.size else float("nan")
