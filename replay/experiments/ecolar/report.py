"""The report of the `ecolar` experiment: calibration, nights in open loop, and the day's rhythm of alpha."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from replay.experiments import published
from replay.experiments.ecolar import plots
from replay.experiments.ecolar.nights import DAYTIME
from replay.experiments.report import Report, Section
from replay.experiments.request import Request
from replay.experiments.series.filtering import Series, Trace
from replay.experiments.table import Cell, Spread, Table, spread
from replay.localtime import DAY, HOUR, wall_clock
from replay.scores import interval_scores, rmse
from replay.scores.intervals import Mask
from replay.simulated.ecolar import ZONE

LEAST_SQUARES = "least squares, offline"
BEST = "RBPF default"


class Run(NamedTuple):
    """One seed of an online estimator: its trace, and the RMSE [K] of the nights with final and evening parameters."""

    trace: Trace
    final: Array
    evening: Array


class PeriodOutcome(NamedTuple):
    """A period: its samples, runs over seeds by estimator, and the nights of least squares over seeds."""

    name: str
    series: Series
    runs: Mapping[str, Sequence[Run]]
    fitted: Sequence[Array]
    at_bound: tuple[str, ...]
    """Parameters that least squares leaves at an end of their box."""


def report(network: Network, request: Request, seeds: Sequence[int], periods: Sequence[PeriodOutcome]) -> Report:
    """The report."""
    real = bool(request.data)
    return Report(
        f"Ecolar Home: {network.name}",
        _lead(periods, real),
        (
            _done(request, seeds, periods),
            _calibration(periods, real),
            _nights(periods, real),
            _rhythm(periods),
            _settings(),
        ),
    )


def daytime(series: Series) -> Mask:
    """(K,): samples between 07:00 and 16:00 local time."""
    hour = wall_clock(series.times, ZONE) % DAY / HOUR
    return (hour >= DAYTIME[0]) & (hour < DAYTIME[1])


def _lead(periods: Sequence[PeriodOutcome], real: bool) -> tuple[str, ...]:
    everywhere = [run.trace for period in periods for run in period.runs[BEST]]
    series = [period.series for period in periods for _ in period.runs[BEST]]
    inside = [
        interval_scores(s.outputs[:, 0], trace.lower, trace.upper).coverage
        for s, trace in zip(series, everywhere, strict=True)
    ]
    sentences = [
        f"Of the temperatures measured, {100 * float(np.mean(inside)):.1f} % fell into the 95 % interval that "
        "Thermogate's default had published five minutes before."
    ]
    for period in periods:
        own = _over([run.final for run in period.runs[BEST]], np.median)
        offline = _over(period.fitted, np.median)
        sentences.append(
            f"{period.name}: simulated through a whole night without measurements, its model is off by {own} K (median "
            f"of {len(period.fitted[0])} nights), one fitted offline to the same weeks by {offline} K."
        )
    if not real:
        sentences.append("The recordings are synthetic stand-ins: the real ones are not public.")
    return tuple(sentences)


def _done(request: Request, seeds: Sequence[int], periods: Sequence[PeriodOutcome]) -> Section:
    told = [
        f"{period.name}: {len(period.series.times):,} complete samples in {int(period.series.starts.sum())} segments"
        for period in periods
    ]
    source = (
        "recorded data (" + ", ".join(f"`{path.name}`" for path in request.data) + ")"
        if request.data
        else "synthetic stand-ins for the two recordings of the paper: a zone with five switched heaters, an adjacent "
        "room, irregular staff, doors, and sun through a shaded façade that no sensor sees"
    )
    return Section(
        "What was done",
        (
            f"Every estimator learned the zone online from {source}; {'; '.join(told)}. Nothing is known of the true "
            "parameters, so the models are judged by what they forecast. Seeds of the estimators: "
            f"{', '.join(map(str, seeds))}; figures are means over seeds ± standard deviation.",
            "Two conventions are never mixed: `one_step` is the interval published before the temperature was "
            "measured, against the measurement. `filtered` is the interval of the state after the measurement, against "
            "that same measurement, as the paper's authors score their table 7; it says little about forecasts.",
        ),
    )


def _calibration(periods: Sequence[PeriodOutcome], real: bool) -> Section:
    tables = [_calibration_table(periods, convention) for convention in ("one_step", "filtered")]
    return Section(
        "Can the intervals be trusted? (Table 7)",
        (
            "By day (07:00 to 16:00) sun and people act that the model does not see; the interval has to widen in "
            "time. At night it has to be narrow.",
        ),
        tuple(tables),
        tuple(plots.week(period.name, period.series, period.runs[BEST][0].trace) for period in periods),
    )


def _calibration_table(periods: Sequence[PeriodOutcome], convention: str) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for period in periods:
        y, day = period.series.outputs[:, 0], daytime(period.series)
        for label, runs in period.runs.items():
            traces = [run.trace for run in runs]
            means, lowers, uppers = zip(*(_bounds(trace, convention) for trace in traces), strict=True)
            whole = [interval_scores(y, a, b) for a, b in zip(lowers, uppers, strict=True)]
            by_day = [interval_scores(y[day], a[day], b[day]).coverage for a, b in zip(lowers, uppers, strict=True)]
            by_night = [
                interval_scores(y[~day], a[~day], b[~day]).coverage for a, b in zip(lowers, uppers, strict=True)
            ]
            rows.append(
                (
                    period.name,
                    label,
                    spread([score.coverage for score in whole]),
                    spread(by_day),
                    spread(by_night),
                    spread([score.width for score in whole]),
                    spread([score.winkler for score in whole]),
                    spread([rmse(mean - y) for mean in means]),
                )
            )
    if convention == "filtered":
        table_7 = published.ECOLAR_CALIBRATION
        figures = (table_7["coverage"], None, None, table_7["width"], None, table_7["rmse"])
        rows.append(("both periods", "RBPF, paper (Table 7), real recordings", *figures))
    return Table(
        f"ecolar-calibration-{convention.replace('_', '-')}",
        f"Calibration, convention {convention} (Table 7)",
        ("period", "estimator", "coverage", "by day", "otherwise", "width, K", "Winkler, K", "RMSE, K"),
        tuple(rows),
        "Nominal 95 %. RMSE is against the measurement.",
        1 if convention == "filtered" else 0,
    )


def _nights(periods: Sequence[PeriodOutcome], real: bool) -> Section:
    rows: list[tuple[Cell, ...]] = []
    for period in periods:
        for label, runs in period.runs.items():
            final, evening = [run.final for run in runs], [run.evening for run in runs]
            rows.append((period.name, label, _over(final, np.median), _over(final, np.std), _over(evening, np.median)))
        rows.append((period.name, LEAST_SQUARES, _over(period.fitted, np.median), _over(period.fitted, np.std), None))
    for (name, label), (median, sd) in published.ECOLAR_NIGHTS.items():
        rows.append((name, f"{label}, paper (Table 8), real recordings", median, sd, None))
    bounds = [f"{period.name}: {', '.join(period.at_bound)}" for period in periods if period.at_bound]
    said = (
        f"Least squares left parameters at an end of their box ({'; '.join(bounds)}): the data say little about them, "
        "or it needs them there to explain heat that it does not see.",
    )
    return Section(
        "Is the model good for planning a night? (Table 8)",
        (
            "From 20:00 to 06:00, with frozen parameters and no measurement: this is what a controller asks of a "
            "model. Every model starts from the state of a Kalman filter with its own parameters over the day before. "
            "'Final' parameters have seen the whole period, as in the paper; 'evening' ones only what came before the "
            "night, as in an installation.",
            *(said if bounds else ()),
        ),
        (
            Table(
                "ecolar-nights",
                "Open-loop RMSE of the nights (Table 8), K",
                ("period", "estimator", "median, final", "standard deviation, final", "median, evening"),
                tuple(rows),
                "Only nights without a gap. Published figures are of the real recordings"
                + ("." if real else " and stand here for orientation: these stand-ins are another building."),
                len(published.ECOLAR_NIGHTS),
            ),
        ),
        (plots.nights({p.name: p.runs[BEST][0].final for p in periods}, {p.name: p.fitted[0] for p in periods}),),
    )


def _rhythm(periods: Sequence[PeriodOutcome]) -> Section:
    return Section(
        "When not to trust the model (Fig. 8)",
        (
            "Alpha hour by hour. Where it stands high every day at the same time there is heat that a sensor could "
            "see: a pyranometer on the façade, a door contact, a CO2 sensor as a measure of people. Alpha in a quiet "
            "night is the level to compare with; plan with wider margins in hours that stand above it.",
        ),
        plots=tuple(plots.rhythm(period.name, period.series, period.runs[BEST][0].trace) for period in periods),
    )


def _settings() -> Section:
    return Section(
        "What to set",
        (
            "`measurement_sd` from the data sheet of the room sensor. Bounds or values of what is known of the "
            "building: `thermogate networks ecolar-6r4c` prints those in force, and a parameter that ends at a bound "
            "is one to look up.",
        ),
    )


def _bounds(trace: Trace, convention: str) -> tuple[Array, Array, Array]:
    if convention == "one_step":
        return trace.mean, trace.lower, trace.upper
    return trace.filtered_mean, trace.filtered_lower, trace.filtered_upper


def _over(errors: Sequence[Array], statistic: Callable[[Array], object]) -> Spread:
    return spread([float(statistic(nights)) if len(nights) else float("nan") for nights in errors])  # type: ignore[arg-type]
