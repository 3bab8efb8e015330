"""`ecolar`: a real zone, where no truth is known (5.2): Ecolar Home's recordings, or synthetic stand-ins for them."""

from collections.abc import Iterator, Mapping

import numpy as np

from estimator.network.presets import PRESETS
from replay.experiments.hours_ahead.recordings import Recording, of_zone
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.request import Request, names_of
from replay.experiments.series.filtering import FilterRun, Series, Trace
from replay.experiments.series.least_squares import LeastSquaresRun, segments_of
from replay.experiments.study import Contender, Figures, Results, Study
from replay.lab.experiments.ecolar.nights import DAYTIME, NightRun, score_nights
from replay.lab.experiments.ecolar.standins import PERIODS, configuration, of_standin
from replay.lab.experiments.published import PUBLISHED
from replay.localtime import DAY, HOUR, wall_clock
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.scores.intervals import interval_scores, rmse
from replay.simulated.ecolar import ZONE

PERIOD = 300
SEEDS = 3
_STARTS = 4
_SHORTEST_SEGMENT = 12
BEST, LEAST_SQUARES = "RBPF default", "least squares, offline"
_NOISE: Mapping[str, object] = {"measurement_sd": 0.1}
"""K, the data sheet's."""
_PAPER: Mapping[str, object] = {"preset": "paper"}
CONTENDERS = tuple(
    Contender(f"{name.upper()} {how}", name, options)
    for name in ("rbpf", "ekf", "ukf")
    for how, options in (("default", _NOISE), ("paper", _PAPER))
)
CONVENTIONS = {
    "one_step": ("mean", "lower", "upper"),
    "filtered": ("filtered_mean", "filtered_lower", "filtered_upper"),
}


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError, ServiceError or ConfigError where it cannot be made."""
    request.accept("data", "seeds", "days", "particles")
    network = PRESETS["ecolar-6r4c"].validate()
    periods = dict(_read(request))
    jobs = []
    for name, series in periods.items():
        for seed in request.seeds_or(SEEDS):
            entered: dict[str, FilterRun | LeastSquaresRun] = {
                one.label: FilterRun(one.estimator, one.options, network, PERIOD, series, seed)
                for one in (contender.with_particles(request.particles) for contender in CONTENDERS)
            }
            segments = segments_of(series, _SHORTEST_SEGMENT)
            entered[LEAST_SQUARES] = LeastSquaresRun(network, PERIOD, segments, _STARTS, seed)
            jobs += [Job(name, label, seed, score_nights, NightRun(run, series)) for label, run in entered.items()]
    return Study(
        jobs,
        lambda job, arrays: figures(periods[job.recording], arrays),
        lambda results: _report(results, bool(request.data), periods),
    )


def figures(series: Series, arrays: Arrays) -> Figures:
    """Of the nights, and of the intervals in both conventions: overall, by day (07:00 to 16:00 local) and otherwise;
    `filtered` ones are held to the measurement, as the paper's authors score theirs."""
    found: dict[str, float] = {}
    for when in ("final", "evening"):
        nights = arrays[f"nights_{when}"]
        if len(nights):
            found |= {f"median, {when}": float(np.median(nights)), f"sd, {when}": float(np.std(nights))}
    if not set(Trace._fields) <= set(arrays):
        return found
    y, hour = series.outputs[:, 0], wall_clock(series.times, ZONE) % DAY / HOUR
    day = (hour >= DAYTIME[0]) & (hour < DAYTIME[1])
    halves = {"by day": day, "otherwise": ~day}
    for convention, columns in CONVENTIONS.items():
        mean, lower, upper = (arrays[column] for column in columns)
        whole = interval_scores(y, lower, upper)
        found |= {
            f"{convention} coverage": whole.coverage,
            f"{convention} width, K": whole.width,
            f"{convention} Winkler, K": whole.winkler,
            f"{convention} RMSE, K": rmse(mean - y),
        }
        for name, rows in halves.items():
            found[f"{convention} {name}"] = interval_scores(y[rows], lower[rows], upper[rows]).coverage
    for name, rows in halves.items():
        alpha = arrays["alpha"][rows, 1]
        found[f"median alpha, {name}"] = float(np.nanmedian(alpha)) if np.isfinite(alpha).any() else float("nan")
    return found


def _report(results: Results, real: bool, periods: Mapping[str, Series]) -> Report:
    document, lead = Document(__package__), list[str]()
    for name in periods:
        lead += document.lines(
            "Lead",
            name=name,
            best=BEST,
            inside=100 * results.mean(name, BEST, "one_step coverage"),
            online=results.spread(name, BEST, "median, final"),
            offline=results.spread(name, LEAST_SQUARES, "median, final"),
        )
    told = "; ".join(
        f"{name}: {len(series.times):,} complete samples in {int(series.starts.sum())} segments"
        for name, series in periods.items()
    )
    of = PUBLISHED["ecolar_calibration"]
    quoted = (of["coverage"], None, None, of["width"], None, of["rmse"])
    sections = (
        document.section("What was done", told=told, source="recorded data" if real else STANDINS),
        document.section(
            "Can the intervals be trusted? (Table 7)",
            *(
                results.table(
                    f"ecolar-calibration-{one.replace('_', '-')}",
                    {name: f"{one} {name}" for name in _CALIBRATION},
                    quoted={_TABLE_7: quoted} if one == "filtered" else {},
                )
                for one in CONVENTIONS
            ),
            results.table("ecolar-alpha", {name: f"median alpha, {name}" for name in ("by day", "otherwise")}),
        ),
        document.section(
            "Is the model good for planning a night? (Table 8)",
            results.table(
                "ecolar-nights",
                {"standard deviation, final" if name.startswith("sd") else name: name for name in _NIGHTS},
                quoted={label: (*both, None) for label, both in PUBLISHED["ecolar_nights"].items()},
            ),
        ),
    )
    return Report(document.title, tuple(lead), sections)


STANDINS = (
    "synthetic stand-ins for the two recordings of the paper: a zone with five switched heaters, an adjacent room, "
    "irregular staff, doors, and sun through a shaded façade that no sensor sees"
)
_CALIBRATION = ("coverage", "by day", "otherwise", "width, K", "Winkler, K", "RMSE, K")
_TABLE_7 = "RBPF, paper (Table 7), real recordings, both periods"
_NIGHTS = ("median, final", "sd, final", "median, evening")


def _read(request: Request) -> Iterator[tuple[str, Series]]:
    """Each period's name and samples: the files of --data, otherwise stand-ins that are written for the purpose."""

    def cut(recording: Recording) -> Series:
        return (recording if request.days is None else recording.first_days(request.days)).series

    for name, path in steps(list(zip(names_of(request.data), request.data, strict=True)), "reading"):
        config = configuration(path)
        yield name, cut(of_zone(config, config.zones[0]))
    for period in steps(() if request.data else PERIODS, "simulating"):
        yield period, cut(of_standin(period, of_zone))
