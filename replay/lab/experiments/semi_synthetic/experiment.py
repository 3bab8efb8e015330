"""`semi-synthetic`: a simulated building whose truth is known, with heat gains that no estimator is told of (5.1)."""

from __future__ import annotations

import re
from collections.abc import Mapping

from estimator.network.network import Network
from replay.experiments.request import Request
from replay.experiments.series.filtering import FLOOR
from replay.experiments.study import Contender, Results, Study, targets
from replay.lab.experiments.published import AUTHORS, CHANNELS, PUBLISHED
from replay.lab.experiments.semi_synthetic.building import (
    AUC,
    BUILDING,
    DOMINATED,
    FILTERED,
    HELD,
    INDEX,
    KNOWING,
    LEAST_SQUARES,
    LOW,
    NOISE,
    ONE_STEP,
    WORST_H2,
    Ready,
    channels,
    key,
    study,
)
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.reports.kit.verdict import Verdict, Wanted, at_least, at_most, between, near
from replay.simulated.semi_synthetic import PERIOD, PROCESS_NOISE_SD

SEEDS = 5


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError or ConfigError where it cannot be made."""
    return study(request, SEEDS, lambda network: {network.name: contenders(network)}, _report)


def contenders(network: Network) -> list[Contender]:
    """Who competes on `network`: on building 67 also with the authors' four parameters held."""
    paper = {"preset": "paper", **NOISE}
    truth = {"process_sd": PROCESS_NOISE_SD, **NOISE}
    everything, free = tuple(parameter.name for parameter in network.parameters), len(network.free)
    kalman = {name.upper(): name for name in ("ekf", "ukf")}
    found = [
        Contender(f"RBPF default, {free} free", "rbpf", NOISE),
        Contender(f"RBPF paper, {free} free", "rbpf", paper),
        # It learns the measurement noise that the others are told.
        Contender(f"MKF, {free} free", "mkf", {}),
    ]
    if network.name == BUILDING and free == len(network.parameters):
        found += [
            Contender("RBPF default, 6 free", "rbpf", NOISE, HELD),
            Contender("RBPF paper, 6 free", "rbpf", paper, HELD),
            Contender("RBPF paper with a_0 = .99, 6 free", "rbpf", paper | {"shrinkage": 0.99}, HELD),
            Contender("RBPF default, true parameters", "rbpf", NOISE, everything),
        ]
    found += [Contender(f"{label} paper, {free} free", name, paper) for label, name in kalman.items()]
    if network.name == BUILDING and free == len(network.parameters):
        slow = paper | {"parameter_sd": 0.001}
        found += [Contender(f"{label} paper, 6 free", name, paper, HELD) for label, name in kalman.items()]
        found += [
            Contender(f"{label} paper with walk .001, 6 free", name, slow, HELD) for label, name in kalman.items()
        ]
    return [
        *found,
        Contender("Kalman filter, true parameters, gain ignored", FLOOR, truth, everything),
        Contender(KNOWING, FLOOR, truth, everything),
        Contender(LEAST_SQUARES, "", {}),
    ]


_RMSE, _WINKLER, _COVERAGE, _, _DOMINATED, _WIDTH = PUBLISHED[FILTERED][AUTHORS]
_FLOOR = PUBLISHED[ONE_STEP]["floor: truth and gain known, reference"][1]
TARGETS: Mapping[str, Mapping[str, Wanted]] = {
    "floor.*": {key(ONE_STEP, "Winkler, K"): near(_FLOOR, 0.01)},
    r"RBPF paper, \d+ free": {
        key(FILTERED, "RMSE, K"): near(_RMSE, 0.05),
        key(FILTERED, "Winkler, K"): near(_WINKLER, 0.05),
        key(FILTERED, "width, K"): near(_WIDTH, 0.05),
        key(FILTERED, "coverage"): between(_COVERAGE - 0.01, _COVERAGE + 0.01),
        key(FILTERED, "coverage", DOMINATED): between(_DOMINATED - 0.01, _DOMINATED + 0.01),
    },
    r"RBPF (default|paper), \d+ free": {
        key(ONE_STEP, "coverage"): between(0.945, 0.96),
        key(ONE_STEP, "Winkler, K"): at_most(0.95),
        INDEX: at_most(1.2),
        AUC: at_least(0.95),
    },
    "RBPF (default|paper), 6 free": {
        f"H2 {name}": at_most(limit) for name, limit in zip(CHANNELS.values(), PUBLISHED["h2"][AUTHORS], strict=True)
    },
    "MKF.*": {
        key(ONE_STEP, "Winkler, K"): at_most(0.88),
        key(ONE_STEP, "coverage", DOMINATED): at_least(0.93),
        WORST_H2: at_most(0.04),
    },
    "[EU]KF paper, .*": {
        key(ONE_STEP, "Winkler, K"): between(2.5, 3.5),
        key(ONE_STEP, "coverage", DOMINATED): at_most(0.1),
    },
    **{
        f"{name} paper with walk.*": {
            key(FILTERED, "RMSE, K"): near(row[0], 0.05),
            key(FILTERED, "Winkler, K"): near(row[1], 0.05),
            key(FILTERED, "coverage", DOMINATED): at_most(0.1),
        }
        for name, row in ((name, PUBLISHED[FILTERED][f"{name}, paper (Table 5)"]) for name in ("EKF", "UKF"))
    },
    "[EU]KF paper.*": {INDEX: at_least(3.0)},
}
"""What the contenders whose label matches are held to, over measured weather and 154 days."""


def verdicts(results: Results) -> list[Verdict]:
    """Every target of every contender."""
    return [
        wanted.judge(f"{label}: {figure}", results.values(results.recordings[0], label, figure))
        for label in results.contenders
        for of, held_to in TARGETS.items()
        if re.fullmatch(of, label)
        for figure, wanted in held_to.items()
    ]


def _report(results: Results, ready: Ready) -> Report:
    """The published numbers and the targets are those of BUILDING alone."""
    ours = ready.network.name == BUILDING
    quoted = PUBLISHED if ours else {table: {} for table in PUBLISHED}
    (name,), own, winkler = results.recordings, results.contenders[0], key(ONE_STEP, "Winkler, K")
    kalman = [label for label in results.contenders if re.fullmatch("[EU]KF paper.*", label)]
    best = min(kalman, key=lambda label: results.mean(name, label, winkler))
    case = next(iter(ready.cases.values()))
    worst, learners = quoted["h_infinity"], [one for one in results.contenders if "true parameters" not in one]
    alpha = PUBLISHED["median_alpha"].values()
    document = Document(__package__)
    lead = document.lines(
        "Lead",
        own=own,
        inside=100 * results.mean(name, own, key(ONE_STEP, "coverage")),
        best=best,
        score=results.spread(name, own, winkler),
        floor=results.spread(name, KNOWING, winkler),
        kalman=results.spread(name, best, winkler),
    )
    sections = (
        document.section(
            "What was done",
            network=name,
            weather=ready.weather,
            seeds=", ".join(map(str, ready.cases)),
            days=len(case.series.times) * PERIOD / 86_400,
            gain=100 * float(case.truth.disturbance_dominated.mean()),
            particles=ready.request.particles or 9000,
        ),
        *([targets(verdicts(results), "docs/experiments.md says why some are missed.")] if ours else []),
        document.section(
            "Can the intervals be trusted?",
            *(
                results.table(f"calibration-{one.replace('_', '-')}", _calibration(one), quoted=quoted[one])
                for one in (ONE_STEP, FILTERED)
            ),
        ),
        document.section(
            "Has it learned the building?",
            results.table(
                "transfer-function-errors",
                [f"{norm} {channel}" for norm in ("H2", "H∞") for channel in channels(ready.network).values()],
                contenders=learners,
                quoted={label: (*h2, *worst.get(label, (None,) * len(h2))) for label, h2 in quoted["h2"].items()},
            ),
            results.table("open-loop", _OPEN_LOOP, quoted=quoted["open_loop"]),
        ),
        document.section(
            "Does it notice what it cannot see?",
            results.table(
                "parasitic-learning",
                _NOTICED,
                contenders=learners,
                quoted={
                    label: (None, None, index, *(alpha if label.startswith("RBPF") else (None, None)), None, None)
                    for label, index in quoted["parasitic_learning"].items()
                },
            ),
            results.table(
                "causes", _CAUSES, contenders=[label for label in results.contenders if label.startswith("RBPF")]
            ),
        ),
    )
    return Report(document.title.format(network=name), lead, sections)


def _calibration(convention: str) -> dict[str, str]:
    columns = {name: key(convention, name) for name in ("RMSE, K", "Winkler, K", "coverage")}
    columns |= {regime: key(convention, "coverage", regime) for regime in (LOW, DOMINATED)}
    return columns | {"width, K": key(convention, "width, K")}


_OPEN_LOOP = {name: f"open loop, {name}" for name in ("mean", "median", "smallest", "largest")}
_NOTICED = (
    *("median update, quiet", "median update, disturbed", INDEX),
    *("median alpha, quiet", "median alpha, disturbed", AUC, "AUC, settled"),
)
_CAUSES = (
    "AUC, one sample later",
    *(f"{of}, {third} third" for of in ("median update", "index") for third in ("first", "last")),
)
