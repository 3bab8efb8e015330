"""Everything the semi-synthetic experiment says of one run: an estimator, a seed, and the truth behind it."""

from __future__ import annotations

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from replay.experiments.series.filtering import Trace
from replay.experiments.study import Figures
from replay.lab.experiments import published
from replay.lab.experiments.semi_synthetic.case import Case
from replay.scores.intervals import Mask, interval_scores, rmse
from replay.scores.learning import area_under_roc, parasitic_learning_index, update_magnitudes
from replay.scores.transfer import transfer_errors
from replay.scores.windows import open_loop_errors, quiet_segments
from replay.simulated.semi_synthetic import PERIOD

OVERALL, LOW, DOMINATED = "overall", "low-disturbance", "disturbance-dominated"
ONE_STEP, FILTERED = "one_step", "filtered"
SETTLING = 6
"""Steps after each beginning and end of the gain that the settled area under the ROC curve leaves out (1 h)."""
INDEX, AUC, WORST_H2 = "parasitic-learning index", "AUC of alpha", "H2, worst channel"


def key(convention: str, score: str, regime: str = OVERALL) -> str:
    """The name of a score of intervals, "RMSE, K", "Winkler, K", "coverage" or "width, K"."""
    return f"{convention} {score}" if regime == OVERALL else f"{convention} {score}, {regime}"


def channels(network: Network) -> dict[str, str]:
    """What the paper calls the inputs of `network`: sun, heater, outside in this order, then any others."""
    named = {name: called for name, called in published.CHANNELS.items() if name in network.inputs}
    return named | {name: name for name in network.inputs if name not in named}


def figures(network: Network, case: Case, trace: Trace) -> Figures:
    """Of `trace`, which an estimator for `network` left on the series of `case`.

    RMSE is against the noise-free temperature in both conventions. `one_step` is the interval published before y_k,
    against y_k; `filtered` that of the state after y_k, against the noise-free state.
    """
    dominated = case.truth.disturbance_dominated
    y, indoor = case.series.outputs[:, 0], case.truth.states[:, network.nodes.index(network.measured[0])]
    found: dict[str, float] = {
        key(ONE_STEP, "RMSE, K"): rmse(trace.mean - indoor),
        key(FILTERED, "RMSE, K"): rmse(trace.filtered_mean - indoor),
    }
    for regime, rows in ((OVERALL, np.ones_like(dominated)), (LOW, ~dominated), (DOMINATED, dominated)):
        found |= _intervals(ONE_STEP, regime, rows, y, trace.lower, trace.upper)
        found |= _intervals(FILTERED, regime, rows, indoor, trace.filtered_lower, trace.filtered_upper)
    magnitudes, alpha = update_magnitudes(trace.theta), trace.alpha[:, 1]
    settled = since_change(dominated) >= SETTLING
    thirds = list(zip(np.array_split(magnitudes, 3), np.array_split(dominated, 3), strict=True))
    found |= {
        "median update, quiet": _median(magnitudes[~dominated]),
        "median update, disturbed": _median(magnitudes[dominated]),
        INDEX: _index(magnitudes, dominated),
        "median alpha, quiet": _median(alpha[~dominated]),
        "median alpha, disturbed": _median(alpha[dominated]),
        AUC: area_under_roc(alpha, dominated),
        "AUC, one sample later": area_under_roc(alpha[1:], dominated[:-1]),
        "AUC, settled": area_under_roc(alpha[settled], dominated[settled]),
        "median update, first third": _median(thirds[0][0]),
        "median update, last third": _median(thirds[2][0]),
        "index, first third": _index(*thirds[0]),
        "index, last third": _index(*thirds[2]),
        # The median, since what else the machine did meanwhile stretches some steps manifold.
        "ms per sample": 1000.0 * float(np.median(trace.seconds)),
    }
    return found | fit_figures(network, case, trace.theta[-1])


def fit_figures(network: Network, case: Case, theta: Array) -> dict[str, float]:
    """Of the parameters `theta` (n_theta,): relative errors of the transfer functions, and of simulating open loop."""
    errors = transfer_errors(network, theta[:, None], true_parameters(network), PERIOD)
    found = {WORST_H2: float(errors.h2[0, 0].max())}
    for name, called in channels(network).items():
        place = network.inputs.index(name)
        found[f"H2 {called}"] = float(errors.h2[0, 0, place])
        found[f"H∞ {called}"] = float(errors.h_infinity[0, 0, place])
    rmses = open_loop(network, case, theta)
    if len(rmses):
        found |= {
            "open loop, mean": float(np.mean(rmses)),
            "open loop, median": float(np.median(rmses)),
            "open loop, smallest": float(np.min(rmses)),
            "open loop, largest": float(np.max(rmses)),
        }
    return found


def open_loop(network: Network, case: Case, theta: Array) -> Array:
    """RMSE [K] of the noise-free temperature on every low-disturbance segment of at least 12 h, from the true state."""
    # Row k of the inputs acts after t_k, so a segment begins where the interval that ends at t_k was already quiet.
    windows = quiet_segments(case.truth.disturbance_dominated, PERIOD)
    indoor = case.truth.states[:, network.nodes.index(network.measured[0])]
    return open_loop_errors(network, theta, PERIOD, windows, case.truth.states, case.series.inputs, indoor)


def true_parameters(network: Network) -> Array:
    """theta (n_theta,) of the simulated building: its nominal values."""
    return np.array([parameter.nominal for parameter in network.parameters], dtype=np.float64)


def since_change(dominated: Mask) -> Array:
    """Steps (K,) since the label last changed, 0 at the change."""
    changed = np.flatnonzero(np.diff(dominated)) + 1
    step = np.arange(len(dominated))
    last = np.concatenate([[-10 * len(dominated)], changed])[np.searchsorted(changed, step, side="right")]
    return step - last


def _intervals(convention: str, regime: str, rows: Mask, y: Array, lower: Array, upper: Array) -> dict[str, float]:
    scores = interval_scores(y[rows], lower[rows], upper[rows])
    names = {"coverage": scores.coverage, "width, K": scores.width, "Winkler, K": scores.winkler}
    return {key(convention, name, regime): value for name, value in names.items()}


def _index(magnitudes: Array, dominated: Mask) -> float:
    """The parasitic-learning index; NaN where nothing moves."""
    return parasitic_learning_index(magnitudes, dominated) if np.nansum(magnitudes) > 0.0 else float("nan")


def _median(values: Array) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if known.size else float("nan")
