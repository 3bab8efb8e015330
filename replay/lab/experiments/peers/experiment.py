"""`peers`: measured buildings that others have fitted, by least squares and by the online estimators on one split."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job, Tick
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun, Trace, filter_job, run_filter
from replay.experiments.series.least_squares import STEPS_A_START, LeastSquaresRun, fit, least_squares_job
from replay.experiments.study import Figures, Results, Run, Study
from replay.experiments.topology.toml import AROUND, proposal
from replay.lab.experiments.peers.data import ARMADILLO, Case, cases
from replay.lab.experiments.peers.scores import one_step, open_loop, persistence, published_parameters, train_segment
from replay.reports.kit.report import Report, Section
from replay.reports.kit.table import Cell, Table

SEEDS = 5
"""Of the particle filter; EKF and UKF draw nothing."""
STARTS = 8
LEAST_SQUARES = "least squares"
CONTENDERS = {
    f"{name.upper()}, {'box around the fit' if boxed else 'wide box'}": (name, boxed)
    for boxed in (False, True)
    for name in ("rbpf", "ekf", "ukf")
}
"""Online estimators by label; `boxed` ones learn within a box around the least-squares fit of the train part."""
DEFAULT = "RBPF, box around the fit"

OPEN_LOOP = ("train RMSE", "train MAE", "test RMSE", "test MAE")
ONE_STEP = ("RMSE [K]", "coverage [%]", "width [K]", "Winkler [K]")


class BoxedRun(NamedTuple):
    """A fit, and a run of an estimator on the same network, whose own box is that of the fit."""

    fit: LeastSquaresRun
    run: FilterRun


def run_boxed(run: BoxedRun, tick: Tick) -> Arrays:
    """The arrays of a `Trace`: fit, draw the boxes around what was found, and run the estimator in them."""
    fitted = fit(run.fit, tick)
    network = proposal(run.run.network, fitted["theta"], tuple(fitted["at_bound"].tolist()))
    return run_filter(run.run._replace(network=network), tick)


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError where its data cannot be used."""
    request.accept("data", "seeds", "particles")
    if request.file is None:
        raise ReplayError(
            "peers needs measured data, which are not shipped: name the folder that holds them with --data"
        )
    found = {case.name: case for case in cases(request.file)}
    runs = tuple(Run(name, label, job) for name, case in found.items() for label, job in _jobs(case, request))
    return Study(
        runs,
        lambda run, arrays: _figures(found[run.recording], arrays),
        lambda results: _report(results, found),
    )


def _jobs(case: Case, request: Request) -> Iterator[tuple[str, Job]]:
    """The fit, then every online estimator."""
    first = LeastSquaresRun(case.network, case.period, [train_segment(case)], STARTS, 0)
    yield LEAST_SQUARES, least_squares_job(f"{case.name} {LEAST_SQUARES}", first)
    seeds = request.seeds_or(SEEDS)
    for label, (name, boxed) in CONTENDERS.items():
        options = dict[str, object](measurement_sd=case.measurement_sd)
        if name == "rbpf" and request.particles is not None:
            options["particles"] = request.particles
        for seed in seeds if name == "rbpf" else seeds[:1]:
            run = FilterRun(name, options, case.network, case.period, case.series, seed)
            steps = first.starts * STEPS_A_START + len(case.series.times)
            boxed_run = Job(f"{case.name} {label}", seed, run_boxed, BoxedRun(first, run), steps)
            yield label, boxed_run if boxed else filter_job(f"{case.name} {label}", run)


def _figures(case: Case, arrays: Arrays) -> Figures:
    """Open loop with the parameters at the end of the train part, and one step ahead."""
    if "initial_states" in arrays:
        scores = open_loop(case, arrays["theta"], arrays["initial_states"][0])
        return dict(zip(OPEN_LOOP, scores[:4], strict=True))
    trace = Trace(**arrays)
    found = dict(zip(OPEN_LOOP, open_loop(case, trace.theta[case.train - 1])[:4], strict=True))
    ahead = one_step(case, trace)
    found["RMSE [K]"] = ahead.rmse
    if ahead.intervals is not None:
        kept = ahead.intervals
        found |= {"coverage [%]": 100 * kept.coverage, "width [K]": kept.width, "Winkler [K]": kept.winkler}
    return found


def _report(results: Results, found: Mapping[str, Case]) -> Report:
    published = {
        f"{case.published.who} ({name}{'; ' + case.published.caveat if case.published.caveat else ''})": (
            case.published.train_rmse,
            case.published.train_mae,
            case.published.test_rmse,
            None,
        )
        for name, case in found.items()
        if case.published.train_rmse is not None
    }
    still = {f"nothing changes ({name})": (persistence(case).rmse, None, None, None) for name, case in found.items()}
    open_loop_table = results.table(
        "open-loop",
        "Open loop [K]",
        {name: name for name in OPEN_LOOP},
        quoted=published,
        note="Least squares minimises the train column; an online estimator minimises the error one step ahead. "
        "Published figures last.",
    )
    one_step_table = results.table(
        "one-step",
        "One step ahead, convention one_step",
        {name: name for name in ONE_STEP},
        contenders=list(CONTENDERS),
        quoted=still,
        note="Over the test part, or all after the first day where there is none; nominal coverage 95 %.",
    )
    lead = []
    for name, case in found.items():
        part = "test RMSE" if case.test else "train RMSE"
        lead.append(
            f"{name}: least squares misses its {part.split()[0]} part by {results.mean(name, LEAST_SQUARES, part):.3f} "
            f"K, with what the RBPF in a box around that fit had learned by then it is "
            f"{results.spread(name, DEFAULT, part)} K."
        )
    armadillo = [_armadillo(results, case) for name, case in found.items() if name == ARMADILLO]
    return Report(
        "Measured buildings that others have fitted",
        tuple(lead),
        (
            Section(
                "What was done",
                (
                    *(f"{name}: {case.what}." for name, case in found.items()),
                    "Least squares fits the parameters, and the temperatures of the hidden nodes at the beginning, to "
                    "the open-loop error of the train part. The online estimators see the same rows once, one by one: "
                    f"in a wide box, and in a box from a {AROUND:.0f}th to {AROUND:.0f} times what least squares found "
                    "on the train part, which is how `thermogate experiment topology` commissions a zone. At the end "
                    "of the train part their parameters are frozen and simulated like those of the fit.",
                    "Every simulation of the test part begins at its first measurement; hidden nodes begin where they "
                    "are after following the measurements of the train part, the same for all. One-step forecasts go "
                    "on learning, as in the daemon. Figures are means over seeds ± standard deviation.",
                ),
            ),
            Section("How near do they come?", (), (open_loop_table, one_step_table)),
            *armadillo,
        ),
    )


def _armadillo(results: Results, case: Case) -> Section:
    found = {f"inputs {name}": scores for name, scores in published_parameters(case).items()}
    ours = tuple(results.mean(case.name, LEAST_SQUARES, name) for name in OPEN_LOOP[:2])
    rows: list[tuple[Cell, ...]] = [
        *((name, scores.train_rmse, scores.train_mae) for name, scores in found.items()),
        ("least squares, ours", *ours),
        ("published", case.published.train_rmse, case.published.train_mae),
    ]
    return Section(
        "armadillo: why our figure is another",
        (
            "The published figure is not the least that 2R2C can do in open loop: it belongs to parameters of a "
            "maximum-likelihood fit, which minimises the error one step ahead. So it is checked by their parameters in "
            "our simulation, with inputs held over the half hour, as ours are, and linear between samples, as theirs "
            "are. What remains goes with the wall's first temperature, which is not published and is taken here to be "
            "the room's.",
        ),
        (
            Table(
                "armadillo-published-parameters",
                "Published parameters of the armadillo house, simulated by us",
                ("parameters and simulation", "RMSE [K]", "MAE [K]"),
                tuple(rows),
                quoted=1,
            ),
        ),
    )
