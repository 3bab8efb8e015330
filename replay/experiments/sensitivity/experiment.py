"""`sensitivity`: what the settings of the particle filter do on the semi-synthetic building (5.1.5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go

from estimator.network.network import Network
from replay.experiments import published
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.report import Plot, Report, Section
from replay.experiments.request import Request
from replay.experiments.semi_synthetic.case import HELD, simulated_case
from replay.experiments.semi_synthetic.plots import COLOURS
from replay.experiments.semi_synthetic.scores import DOMINATED, OVERALL, RunScores, score
from replay.experiments.semi_synthetic.tables import BUILDING, over_seeds
from replay.experiments.series.filtering import FilterRun, Trace, filter_job
from replay.experiments.series.networks import network_of
from replay.experiments.table import Cell, Spread, Table
from replay.simulated.semi_synthetic import MEASUREMENT_NOISE_SD, PERIOD

SEEDS = 2


class Base(NamedTuple):
    """Settings around which one thing at a time is changed."""

    label: str
    options: Mapping[str, object]
    held: tuple[str, ...] = ()


class Change(NamedTuple):
    """One thing changed; `published` is the paper's own finding, if it has one."""

    label: str
    options: Mapping[str, object]
    published: str | None = None


def changes(particles: int) -> list[Change]:
    """What is changed, beginning with nothing; particle counts are a third and 5/3 of `particles`, as in the paper."""
    found = published.SENSITIVITY
    fewer, more = particles // 3, particles * 5 // 3
    gates = [
        Change(f"gate {low:g} to {high:g}", {"gate_low": low, "gate_high": high}, found["gate"])
        for low, high in ((0.15, 0.5), (0.15, 0.9), (0.4, 0.9))
    ]
    return [
        Change("as it is", {"particles": particles}, found.get(f"particles {particles}")),
        Change(f"{fewer:,} particles", {"particles": fewer}, found.get(f"particles {fewer}")),
        Change(f"{more:,} particles", {"particles": more}, found.get(f"particles {more}")),
        Change("volatility_sd .05", {"volatility_sd": 0.05}, found["volatility_sd 0.05"]),
        Change("volatility_sd .2", {"volatility_sd": 0.2}, found["volatility_sd 0.2"]),
        *gates,
        Change("measurement_sd halved", {"measurement_sd": MEASUREMENT_NOISE_SD / 2}),
        Change("measurement_sd doubled", {"measurement_sd": MEASUREMENT_NOISE_SD * 2}),
    ]


def bases(network: Network) -> list[Base]:
    """Thermogate's default and, for the building of the paper, the paper's settings as its authors ran them."""
    noise = {"measurement_sd": MEASUREMENT_NOISE_SD}
    found = [Base("default", noise)]
    if network.name == BUILDING:
        found.append(Base("paper, 6 free", {"preset": "paper", **noise}, HELD))
    return found


class Sensitivity:
    """The experiment, made ready."""

    def __init__(self, request: Request) -> None:
        request.accept("data", "seeds", "days", "particles", "network", "config", "zone", "overrides")
        self._request = request
        self._network = network_of(request, BUILDING).validate()
        self._seeds = request.seeds_or(SEEDS)
        self._cases = [simulated_case(self._network, request, seed) for seed in steps(self._seeds, "simulating")]
        self._changes = changes(request.particles or 9000)
        self._bases = bases(self._network)

    def jobs(self) -> list[Job]:
        """Base by base, change by change, seed by seed."""
        every = {"particles": self._request.particles} if self._request.particles else {}
        return [
            filter_job(
                f"{base.label}, {change.label}",
                FilterRun(
                    "rbpf",
                    {**base.options, **every, **change.options},
                    self._network.with_fixed(base.held),
                    PERIOD,
                    case.series,
                    seed,
                ),
            )
            for base in self._bases
            for change in self._changes
            for seed, case in zip(self._seeds, self._cases, strict=True)
        ]

    def report(self, results: Sequence[Arrays]) -> Report:
        """A table and a figure for each base."""
        rest = iter(results)
        sections, lead = [], []
        for base in self._bases:
            scores: dict[str, list[RunScores]] = {}
            seconds: dict[str, float] = {}
            for change in self._changes:
                traces = [Trace(**next(rest)) for _ in self._seeds]
                seconds[change.label] = float(np.mean([np.median(trace.seconds) for trace in traces]))
                scores[change.label] = [
                    score(self._network, case.series, case.truth, trace)
                    for case, trace in zip(self._cases, traces, strict=True)
                ]
            sections.append(self._section(base, scores, seconds))
            lead.append(_most(base, scores))
        return Report(f"Sensitivity: {self._network.name}", tuple(lead), (self._done(), *sections, _settings()))

    def _done(self) -> Section:
        request, steps = self._request, len(self._cases[0].series.times)
        weather = "weather generated for Konstanz" if request.file is None else f"weather from `{request.file.name}`"
        return Section(
            "What was done",
            (
                f"The simulated building `{self._network.name}` of the semi-synthetic experiment, {steps:,} samples "
                f"over {weather}, was learned again and again with one setting changed at a time. Seeds: "
                f"{', '.join(map(str, self._seeds))}; figures are means ± standard deviation. The paper's findings "
                "stand in the last column; its coverages and widths are of the `filtered` convention.",
            ),
        )

    def _section(self, base: Base, scores: Mapping[str, list[RunScores]], seconds: Mapping[str, float]) -> Section:
        rows: list[tuple[Cell, ...]] = []
        for change in self._changes:
            runs = scores[change.label]
            figures = [over_seeds(runs, pick) for pick in _PICKS.values()]
            rows.append((change.label, *figures, 1000 * seconds[change.label], change.published))
        table = Table(
            f"sensitivity-{base.label.split(',')[0]}",
            f"Around '{base.label}', one thing changed at a time (5.1.5)",
            ("changed", *_PICKS, "ms per sample", "paper"),
            tuple(rows),
            "Open-loop RMSE: median over low-disturbance segments of at least 12 h, final parameters.",
        )
        return Section(f"Settings around '{base.label}'", tables=(table,), plots=(_plot(base, scores),))


def prepare(request: Request) -> Sensitivity:
    """The experiment for `request`; ReplayError or ConfigError where it cannot be made."""
    return Sensitivity(request)


def _open_loop(run: RunScores) -> float:
    return float(np.median(run.open_loop)) if len(run.open_loop) else float("nan")


_PICKS: dict[str, Callable[[RunScores], float]] = {
    "open-loop RMSE, K": _open_loop,
    "one_step coverage": lambda run: run.one_step[OVERALL].coverage,
    "one_step coverage, disturbed": lambda run: run.one_step[DOMINATED].coverage,
    "one_step Winkler, K": lambda run: run.one_step[OVERALL].winkler,
    "filtered coverage": lambda run: run.filtered[OVERALL].coverage,
    "filtered coverage, disturbed": lambda run: run.filtered[DOMINATED].coverage,
    "filtered width, K": lambda run: run.filtered[OVERALL].width,
    "parasitic-learning index": lambda run: run.parasitic_learning,
    "AUC of alpha": lambda run: run.auc,
}


def _most(base: Base, scores: Mapping[str, list[RunScores]]) -> str:
    winkler: dict[str, Spread] = {
        label: over_seeds(runs, _PICKS["one_step Winkler, K"]) for label, runs in scores.items()
    }
    as_is = next(iter(winkler.values()))
    far = max(winkler, key=lambda label: abs(winkler[label].mean - as_is.mean))
    return (
        f"Around '{base.label}' the one-step Winkler score of {as_is} K changes most with '{far}': to {winkler[far]} K."
    )


def _plot(base: Base, scores: Mapping[str, list[RunScores]]) -> Plot:
    figure = go.Figure()
    for place, name in enumerate(("one_step Winkler, K", "open-loop RMSE, K")):
        figures = [over_seeds(runs, _PICKS[name]) for runs in scores.values()]
        sds = [0.0 if np.isnan(figure.sd) else figure.sd for figure in figures]
        figure.add_trace(
            go.Bar(
                x=list(scores),
                y=[figure.mean for figure in figures],
                error_y={"array": sds},
                name=name,
                marker_color=COLOURS[place],
            )
        )
    figure.update_layout(barmode="group", yaxis_title="K")
    return Plot(
        f"Forecast and planning error around '{base.label}'",
        figure,
        "Bars are means over seeds, whiskers their standard deviation: a difference smaller than the whiskers is "
        "chance.",
    )


def _settings() -> Section:
    return Section(
        "What to set",
        (
            "`measurement_sd` is the one setting that only you can know: the noise of your sensor, from its data "
            "sheet; the last two rows of each table show what a wrong one costs. Leave the others at their defaults "
            "unless a row is better by more than its standard deviation in every column that you care about.",
        ),
    )
