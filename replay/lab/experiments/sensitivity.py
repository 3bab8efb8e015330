"""`sensitivity`: what the settings of the particle filter do on the semi-synthetic building (5.1.5)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from replay.experiments.progress import steps
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun, Trace, filter_job
from replay.experiments.series.networks import network_of
from replay.experiments.study import Results, Run, Study
from replay.lab.experiments import published
from replay.lab.experiments.semi_synthetic.case import HELD, simulated_case
from replay.lab.experiments.semi_synthetic.experiment import BUILDING
from replay.lab.experiments.semi_synthetic.figures import AUC, DOMINATED, FILTERED, INDEX, ONE_STEP, figures, key
from replay.reports.kit.report import Report, Section
from replay.reports.kit.table import Table
from replay.simulated.semi_synthetic import MEASUREMENT_NOISE_SD, PERIOD

SEEDS = 2
WINKLER = key(ONE_STEP, "Winkler, K")
COLUMNS = {
    "open-loop RMSE, K": "open loop, median",
    "one_step coverage": key(ONE_STEP, "coverage"),
    "one_step coverage, disturbed": key(ONE_STEP, "coverage", DOMINATED),
    "one_step Winkler, K": WINKLER,
    "filtered coverage": key(FILTERED, "coverage"),
    "filtered coverage, disturbed": key(FILTERED, "coverage", DOMINATED),
    "filtered width, K": key(FILTERED, "width, K"),
    INDEX: INDEX,
    AUC: AUC,
    "ms per sample": "ms per sample",
}


class Change(NamedTuple):
    """One thing changed; `published` is the paper's own finding, if it has one."""

    label: str
    options: Mapping[str, object]
    published: str | None = None


def changes(particles: int) -> list[Change]:
    """What is changed, beginning with nothing; particle counts are a third and 5/3 of `particles`, as in the paper."""
    found = published.SENSITIVITY
    counts = {"as it is": particles}
    counts |= {f"{count:,} particles": count for count in (particles // 3, particles * 5 // 3)}
    return [
        *(Change(label, {"particles": count}, found.get(f"particles {count}")) for label, count in counts.items()),
        Change("volatility_sd .05", {"volatility_sd": 0.05}, found["volatility_sd 0.05"]),
        Change("volatility_sd .2", {"volatility_sd": 0.2}, found["volatility_sd 0.2"]),
        *(
            Change(f"gate {low:g} to {high:g}", {"gate_low": low, "gate_high": high}, found["gate"])
            for low, high in ((0.15, 0.5), (0.15, 0.9), (0.4, 0.9))
        ),
        Change("measurement_sd halved", {"measurement_sd": MEASUREMENT_NOISE_SD / 2}),
        Change("measurement_sd doubled", {"measurement_sd": MEASUREMENT_NOISE_SD * 2}),
    ]


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError or ConfigError where it cannot be made."""
    request.accept("data", "seeds", "days", "particles", "network", "config", "zone", "overrides")
    network = network_of(request, BUILDING).validate()
    cases = {seed: simulated_case(network, request, seed) for seed in steps(request.seeds_or(SEEDS), "simulating")}
    changed = changes(request.particles or 9000)
    noise: dict[str, object] = {"measurement_sd": MEASUREMENT_NOISE_SD}
    bases = {"default": (noise, network)}
    if network.name == BUILDING:
        bases["paper, 6 free"] = ({"preset": "paper", **noise}, network.with_fixed(HELD))
    every = {"particles": request.particles} if request.particles else {}
    runs = tuple(
        Run(
            base,
            change.label,
            filter_job(
                f"{base}, {change.label}",
                FilterRun("rbpf", {**options, **every, **change.options}, free, PERIOD, case.series, seed),
            ),
        )
        for base, (options, free) in bases.items()
        for change in changed
        for seed, case in cases.items()
    )
    return Study(
        runs,
        lambda run, arrays: figures(network, cases[run.job.seed], Trace(**arrays)),
        lambda results: _report(results, changed, request),
    )


def _report(results: Results, changed: list[Change], request: Request) -> Report:
    weather = "weather generated for Konstanz" if request.file is None else f"weather from `{request.file.name}`"
    done = (
        f"The building of the semi-synthetic experiment, over {weather}, was learned again and again with one setting "
        "changed at a time; figures are means over seeds ± standard deviation. The paper's findings stand in the last "
        "column; its coverages and widths are of the `filtered` convention."
    )
    return Report(
        "Sensitivity of the particle filter",
        tuple(_most(results, base) for base in results.recordings),
        (
            Section("What was done", (done,)),
            *(
                Section(f"Settings around '{base}'", (), (_table(results, base, changed),))
                for base in results.recordings
            ),
        ),
    )


def _table(results: Results, base: str, changed: list[Change]) -> Table:
    rows = (
        (one.label, *(results.spread(base, one.label, figure) for figure in COLUMNS.values()), one.published)
        for one in changed
    )
    return Table(
        f"sensitivity-{base.split(',')[0]}",
        f"Around '{base}', one thing changed at a time (5.1.5)",
        ("changed", *COLUMNS, "paper"),
        tuple(rows),
        "Open-loop RMSE: median over low-disturbance segments of at least 12 h, final parameters.",
    )


def _most(results: Results, base: str) -> str:
    winkler = {label: results.mean(base, label, WINKLER) for label in results.contenders}
    as_is = winkler["as it is"]
    far = max(winkler, key=lambda label: abs(winkler[label] - as_is))
    return (
        f"Around '{base}' the one-step Winkler score of {as_is:.3f} K changes most with '{far}': to "
        f"{winkler[far]:.3f} K."
    )
