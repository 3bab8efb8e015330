"""`ecolar`: a real zone, where no truth is known (5.2): Ecolar Home's recordings, or synthetic stand-ins for them."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from estimator.network.presets import network as preset
from replay.errors import ReplayError
from replay.experiments.hours_ahead.recordings import of_zone
from replay.experiments.jobs import Arrays
from replay.experiments.progress import steps
from replay.experiments.request import Request, names_of
from replay.experiments.series.filtering import FilterRun, Series, Trace
from replay.experiments.series.least_squares import LeastSquaresRun, segments_of
from replay.experiments.series.networks import network_of
from replay.experiments.study import Contender, Figures, Results, Run, Study
from replay.lab import EXAMPLES
from replay.lab.experiments import published
from replay.lab.experiments.ecolar.nights import DAYTIME, NightRun, night_job
from replay.localtime import DAY, HOUR, wall_clock
from replay.reports.kit.report import Report, Section
from replay.reports.kit.table import Table
from replay.scores.intervals import interval_scores, rmse
from replay.simulated.ecolar import PERIODS, ZONE, write_standin
from service.config.load import Config, load

NETWORK = "ecolar-6r4c"
PERIOD = 300
MEASUREMENT_SD = 0.1
"""K, the data sheet's."""
SEEDS = 3
_STARTS = 4
_SHORTEST_SEGMENT = 12
BEST, LEAST_SQUARES = "RBPF default", "least squares, offline"


_NOISE: Mapping[str, object] = {"measurement_sd": MEASUREMENT_SD}
CONTENDERS = (
    Contender("RBPF default", "rbpf", _NOISE),
    Contender("RBPF paper", "rbpf", {"preset": "paper"}),
    Contender("EKF default", "ekf", _NOISE),
    Contender("EKF paper", "ekf", {"preset": "paper"}),
    Contender("UKF default", "ukf", _NOISE),
    Contender("UKF paper", "ukf", {"preset": "paper"}),
)


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError, ServiceError or ConfigError where it cannot be made."""
    request.accept("data", "seeds", "days", "particles", "network", "config", "zone", "overrides")
    network = network_of(request, NETWORK).validate()
    needed = preset(NETWORK).channels
    if network.channels != needed:
        raise ReplayError(
            f"network '{network.name}' does not fit the recording; it needs the channels {', '.join(needed)}"
        )
    periods = dict(_read(request))
    runs = []
    for name, series in periods.items():
        for seed in request.seeds_or(SEEDS):
            for contender in CONTENDERS:
                options = contender.with_particles(request.particles).options
                run = FilterRun(contender.estimator, options, network, PERIOD, series, seed)
                job = night_job(f"{name} {contender.label}", NightRun(run, series, ZONE))
                runs.append(Run(name, contender.label, job))
            fit = LeastSquaresRun(network, PERIOD, segments_of(series, _SHORTEST_SEGMENT), _STARTS, seed)
            job = night_job(f"{name} {LEAST_SQUARES}", NightRun(fit, series, ZONE))
            runs.append(Run(name, LEAST_SQUARES, job))
    return Study(
        tuple(runs),
        lambda run, arrays: figures(periods[run.recording], arrays),
        lambda results: _report(results, request, periods),
    )


def figures(series: Series, arrays: Arrays) -> Figures:
    """Of the nights, and of the intervals in both conventions: overall, by day (07:00 to 16:00 local) and otherwise.

    `filtered` intervals are held to the measurement here, as the paper's authors score theirs.
    """
    found: dict[str, float] = {}
    for when in ("final", "evening"):
        nights = arrays[f"nights_{when}"]
        if len(nights):
            found |= {f"median, {when}": float(np.median(nights)), f"sd, {when}": float(np.std(nights))}
    if "mean" not in arrays:
        return found
    trace = Trace(**{field: arrays[field] for field in Trace._fields})
    y, hour = series.outputs[:, 0], wall_clock(series.times, ZONE) % DAY / HOUR
    day = (hour >= DAYTIME[0]) & (hour < DAYTIME[1])
    conventions = {
        "one_step": (trace.mean, trace.lower, trace.upper),
        "filtered": (trace.filtered_mean, trace.filtered_lower, trace.filtered_upper),
    }
    for convention, (mean, lower, upper) in conventions.items():
        whole = interval_scores(y, lower, upper)
        found |= {
            f"{convention} coverage": whole.coverage,
            f"{convention} by day": interval_scores(y[day], lower[day], upper[day]).coverage,
            f"{convention} otherwise": interval_scores(y[~day], lower[~day], upper[~day]).coverage,
            f"{convention} width, K": whole.width,
            f"{convention} Winkler, K": whole.winkler,
            f"{convention} RMSE, K": rmse(mean - y),
        }
    for name, rows in (("by day", day), ("otherwise", ~day)):
        found[f"median alpha, {name}"] = (
            float(np.nanmedian(trace.alpha[rows, 1])) if np.isfinite(trace.alpha[rows, 1]).any() else float("nan")
        )
    return found


def _report(results: Results, request: Request, periods: Mapping[str, Series]) -> Report:
    told = "; ".join(
        f"{name}: {len(series.times):,} complete samples in {int(series.starts.sum())} segments"
        for name, series in periods.items()
    )
    source = (
        "recorded data"
        if request.data
        else "synthetic stand-ins for the two recordings of the paper: a zone with five switched heaters, an adjacent "
        "room, irregular staff, doors, and sun through a shaded façade that no sensor sees"
    )
    lead = [
        f"{name}: {100 * results.mean(name, BEST, 'one_step coverage'):.1f} % of the temperatures fell into the 95 % "
        f"interval published five minutes before. Simulated through a whole night without measurements, the model of "
        f"{BEST} is off by {results.spread(name, BEST, 'median, final')} K (median), one fitted offline to the same "
        f"weeks by {results.spread(name, LEAST_SQUARES, 'median, final')} K."
        for name in periods
    ]
    return Report(
        "Ecolar Home",
        tuple(lead),
        (
            Section(
                "What was done",
                (
                    f"Every estimator learned the zone online from {source}; {told}. Nothing is known of the true "
                    "parameters, so the models are judged by what they forecast. Figures are means over the seeds of "
                    "the estimators ± standard deviation. `filtered` intervals are of the state after the measurement, "
                    "against that same measurement, as in the paper's table 7; they say little about forecasts.",
                ),
            ),
            Section(
                "Can the intervals be trusted? (Table 7)",
                ("By day (07:00 to 16:00) sun and people act that the model does not see.",),
                (*(_calibration(results, convention) for convention in ("one_step", "filtered")), _alpha(results)),
            ),
            Section(
                "Is the model good for planning a night? (Table 8)",
                (
                    "From 20:00 to 06:00, with frozen parameters and no measurement. Every model starts from the state "
                    "of a Kalman filter with its own parameters over the day before. 'Final' parameters have seen the "
                    "whole period, as in the paper; 'evening' ones only what came before the night.",
                ),
                (_nights(results, bool(request.data)),),
            ),
        ),
    )


def _calibration(results: Results, convention: str) -> Table:
    names = ("coverage", "by day", "otherwise", "width, K", "Winkler, K", "RMSE, K")
    of = published.ECOLAR_CALIBRATION
    figures_of_the_paper = (of["coverage"], None, None, of["width"], None, of["rmse"])
    quoted = {"RBPF, paper (Table 7), real recordings, both periods": figures_of_the_paper}
    return results.table(
        f"ecolar-calibration-{convention.replace('_', '-')}",
        f"Calibration, convention {convention} (Table 7)",
        {name: f"{convention} {name}" for name in names},
        quoted=quoted if convention == "filtered" else {},
        note="Nominal 95 %. RMSE is against the measurement.",
    )


def _alpha(results: Results) -> Table:
    return results.table(
        "ecolar-alpha",
        "Median of alpha (Fig. 8)",
        {name: f"median alpha, {name}" for name in ("by day", "otherwise")},
        note="Where it stands higher by day there is heat that a sensor could see: sun on the façade, doors, people.",
    )


def _nights(results: Results, real: bool) -> Table:
    return results.table(
        "ecolar-nights",
        "Open-loop RMSE of the nights (Table 8), K",
        {
            "median, final": "median, final",
            "standard deviation, final": "sd, final",
            "median, evening": "median, evening",
        },
        quoted={
            f"{label}, paper (Table 8), {period}, real recordings": (median, sd, None)
            for (period, label), (median, sd) in published.ECOLAR_NIGHTS.items()
        },
        note="Only nights without a gap. Published figures are of the real recordings"
        + ("." if real else " and stand here for orientation: these stand-ins are another building."),
    )


def _read(request: Request) -> Iterator[tuple[str, Series]]:
    """Each period's name and samples: the files of --data, otherwise stand-ins that are written for the purpose."""
    with tempfile.TemporaryDirectory(prefix="thermogate-ecolar-") as folder:
        files = list(zip(names_of(request.data), request.data, strict=True)) or [
            (name, write_standin(Path(folder) / f"ecolar-{name}-SYNTHETIC.csv", name))
            for name in steps(PERIODS, "simulating")
        ]
        for name, path in steps(files, "reading"):
            config = configuration(path)
            recording = of_zone(config, config.zones[0])
            yield name, (recording if request.days is None else recording.first_days(request.days)).series


def configuration(log: Path) -> Config:
    """The example of a zone that `log`, in Ecolar's raw layout, feeds; it is preprocessed as in paper 4.3.1."""
    return load(EXAMPLES / "ecolar.toml", [f"sources.recording.files={json.dumps([str(log.resolve())])}"])
