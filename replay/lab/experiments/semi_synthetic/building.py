"""The semi-synthetic building: its data by seed, as estimators take them, and the truth to which a run is held."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.gaussian.floor import GAIN_CHANNEL, with_known_gain
from estimator.network.presets import PRESETS
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun, Series, Trace, run_filter
from replay.experiments.series.least_squares import LeastSquaresRun, fit, segments_of
from replay.experiments.study import Contender, Figures, Results, Study
from replay.lab.experiments.published import CHANNELS
from replay.reports.kit.report import Report
from replay.scores.intervals import Mask, interval_scores, rmse
from replay.scores.learning import area_under_roc, parasitic_learning_index, update_magnitudes
from replay.scores.transfer import transfer_errors
from replay.scores.windows import open_loop_errors, quiet_segments
from replay.simulated.semi_synthetic import MEASUREMENT_NOISE_SD, PERIOD, Truth, generate

NETWORK = PRESETS["building-67"].validate()
HELD = ("C_i", "C_h", "C_s", "g_is")
"""Parameters that the authors' runs hold at the truth."""
NOISE: Mapping[str, object] = {"measurement_sd": MEASUREMENT_NOISE_SD}
LEAST_SQUARES, KNOWING = "least squares, offline", "floor: true parameters, gain known"
_STARTS = 3

OVERALL, LOW, DOMINATED = "overall", "low-disturbance", "disturbance-dominated"
ONE_STEP, FILTERED = "one_step", "filtered"
INDEX, AUC, WORST_H2 = "parasitic-learning index", "AUC of alpha", "H2, worst channel"
SETTLING = 6
"""Steps after each beginning and end of the gain that the settled area under the ROC curve leaves out (1 h)."""


class Case(NamedTuple):
    series: Series
    truth: Truth


def simulated_case(request: Request, seed: int) -> Case:
    """The building simulated over the weather of `request`; ReplayError where that cannot be."""
    recording = generate(request.file, days=request.days, seed=seed)
    outputs, inputs = (
        np.column_stack([recording.columns[name] for name in names]) for names in (NETWORK.measured, NETWORK.inputs)
    )
    starts = np.arange(len(recording.times)) == 0
    return Case(Series(recording.times, outputs, inputs, starts), recording.truth)


class Ready(NamedTuple):
    """What the report is told of an experiment on this building."""

    request: Request
    cases: Mapping[int, Case]

    @property
    def weather(self) -> str:
        file = self.request.file
        return "weather generated for Konstanz" if file is None else f"weather from `{file.name}`"


def study(
    request: Request,
    seeds: int,
    entered: Mapping[str, Sequence[Contender]],
    written: Callable[[Results, Ready], Report],
) -> Study:
    """The contenders `entered` by recording, each over the building of every seed (`seeds` of them, unless others are
    asked for). ReplayError where `request` cannot be met.

    The contender LEAST_SQUARES is a fit; KNOWING is told of the gain as well.
    """
    request.accept("data", "seeds", "days", "particles")
    cases = {seed: simulated_case(request, seed) for seed in steps(request.seeds_or(seeds), "simulating")}
    jobs = [
        _job(recording, case, seed, one.with_particles(request.particles))
        for recording, contenders in entered.items()
        for one in contenders
        for seed, case in cases.items()
    ]

    def measure(job: Job, arrays: Arrays) -> Figures:
        case = cases[job.seed]
        if job.contender == LEAST_SQUARES:
            return learned(case, arrays["theta"])
        return figures(case, Trace(**arrays))

    return Study(jobs, measure, lambda results: written(results, Ready(request, cases)))


def _job(recording: str, case: Case, seed: int, contender: Contender) -> Job:
    label, own, series = contender.label, NETWORK.with_fixed(contender.held), case.series
    if label == LEAST_SQUARES:
        return Job(recording, label, seed, fit, LeastSquaresRun(NETWORK, PERIOD, segments_of(series), _STARTS, seed))
    if label == KNOWING:
        own = with_known_gain(own, NETWORK.measured[0], GAIN_CHANNEL)
        series = series._replace(inputs=np.column_stack([series.inputs, case.truth.unmeasured_gain]))
    run = FilterRun(contender.estimator, contender.options, own, PERIOD, series, seed)
    return Job(recording, label, seed, run_filter, run)


def key(convention: str, score: str, regime: str = OVERALL) -> str:
    """The name of a score of intervals, "RMSE, K", "Winkler, K", "coverage" or "width, K"."""
    return f"{convention} {score}" if regime == OVERALL else f"{convention} {score}, {regime}"


def figures(case: Case, trace: Trace) -> Figures:
    """Of `trace`, which an estimator left on the series of `case`. `one_step` intervals, published before y_k, are held
    to y_k, `filtered` ones, of the state after y_k, to the noise-free state, and so is RMSE in both."""
    dominated, indoor = case.truth.disturbance_dominated, _indoor(case)
    one_step = (case.series.outputs[:, 0], trace.mean, trace.lower, trace.upper)
    filtered = (indoor, trace.filtered_mean, trace.filtered_lower, trace.filtered_upper)
    found: dict[str, float] = {}
    for convention, (y, mean, lower, upper) in ((ONE_STEP, one_step), (FILTERED, filtered)):
        found[key(convention, "RMSE, K")] = rmse(mean - indoor)
        for regime, rows in ((OVERALL, np.ones_like(dominated)), (LOW, ~dominated), (DOMINATED, dominated)):
            scores = interval_scores(y[rows], lower[rows], upper[rows])
            found[key(convention, "coverage", regime)] = scores.coverage
            found[key(convention, "width, K", regime)] = scores.width
            found[key(convention, "Winkler, K", regime)] = scores.winkler
    magnitudes, alpha = update_magnitudes(trace.theta), trace.alpha[:, 1]
    settled = since_change(dominated) >= SETTLING
    for name, rows in (("quiet", ~dominated), ("disturbed", dominated)):
        found[f"median update, {name}"] = _median(magnitudes[rows])
        found[f"median alpha, {name}"] = _median(alpha[rows])
    thirds = list(zip(np.array_split(magnitudes, 3), np.array_split(dominated, 3), strict=True))
    for name, (moved, acted) in (("first third", thirds[0]), ("last third", thirds[2])):
        found[f"median update, {name}"], found[f"index, {name}"] = _median(moved), _index(moved, acted)
    return {
        **found,
        INDEX: _index(magnitudes, dominated),
        AUC: area_under_roc(alpha, dominated),
        "AUC, one sample later": area_under_roc(alpha[1:], dominated[:-1]),
        "AUC, settled": area_under_roc(alpha[settled], dominated[settled]),
        # The median, since what else the machine did meanwhile stretches some steps manifold.
        "ms per sample": 1000.0 * float(np.median(trace.seconds)),
        **learned(case, trace.theta[-1]),
    }


def learned(case: Case, theta: Array) -> Figures:
    """Of the parameters `theta` (n_theta,): relative errors of the transfer functions, and the RMSE [K] of the
    noise-free temperature on every low-disturbance segment of at least 12 h, open loop from the true state."""
    truth = np.array([parameter.nominal for parameter in NETWORK.parameters], dtype=np.float64)
    errors = transfer_errors(NETWORK, theta[:, None], truth, PERIOD)
    found = {WORST_H2: float(errors.h2[0, 0].max())}
    for name, called in CHANNELS.items():
        place = NETWORK.inputs.index(name)
        found[f"H2 {called}"] = float(errors.h2[0, 0, place])
        found[f"H∞ {called}"] = float(errors.h_infinity[0, 0, place])
    # Row k of the inputs acts after t_k, so a segment begins where the interval that ends at t_k was already quiet.
    windows, states = quiet_segments(case.truth.disturbance_dominated, PERIOD), case.truth.states
    rmses = open_loop_errors(NETWORK, theta, PERIOD, windows, states, case.series.inputs, _indoor(case))
    if len(rmses):
        statistics = {
            "mean": np.mean(rmses),
            "median": np.median(rmses),
            "smallest": rmses.min(),
            "largest": rmses.max(),
        }
        found |= {f"open loop, {name}": float(value) for name, value in statistics.items()}
    return found


def _indoor(case: Case) -> Array:
    """The noise-free temperature (K,)."""
    return case.truth.states[:, NETWORK.nodes.index(NETWORK.measured[0])]


def since_change(dominated: Mask) -> Array:
    """Steps (K,) since the label last changed, 0 at the change."""
    changed = np.flatnonzero(np.diff(dominated)) + 1
    step = np.arange(len(dominated))
    last = np.concatenate([[-10 * len(dominated)], changed])[np.searchsorted(changed, step, side="right")]
    return step - last


def _index(magnitudes: Array, dominated: Mask) -> float:
    """The parasitic-learning index; NaN where nothing moves."""
    return parasitic_learning_index(magnitudes, dominated) if np.nansum(magnitudes) > 0.0 else float("nan")


def _median(values: Array) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if known.size else float("nan")
