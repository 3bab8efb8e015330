"""`semi-synthetic`: a simulated building whose truth is known, with heat gains that no estimator is told of (5.1)."""

import re
import tomllib
from collections.abc import Mapping
from importlib.resources import files

from replay.experiments.request import Request
from replay.experiments.study import Contender, Results, Study, targets
from replay.lab.experiments.published import CHANNELS, PUBLISHED
from replay.lab.experiments.semi_synthetic import building
from replay.lab.experiments.semi_synthetic.building import FILTERED, NETWORK, ONE_STEP, Ready, key
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.reports.kit.verdict import WANTED, Verdict, Wanted
from replay.simulated.semi_synthetic import PERIOD

SEEDS = 5


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError where it cannot be made."""
    return building.study(request, SEEDS, {NETWORK.name: contenders()}, _report)


_DATA = tomllib.loads(files(__package__).joinpath("experiment.toml").read_text(encoding="utf-8"))
TARGETS: Mapping[str, Mapping[str, Wanted]] = {
    of: {figure: WANTED[kind](*given) for figure, row in table.items() for kind, given in row.items()}
    for of, table in _DATA["targets"].items()
}


def contenders() -> list[Contender]:
    held = {"authors": building.HELD, "all": tuple(parameter.name for parameter in NETWORK.parameters), None: ()}
    return [
        Contender(row["label"], row["estimator"], row.get("options", {}), held[row.get("held")])
        for row in _DATA["contenders"]
    ]


def verdicts(results: Results) -> list[Verdict]:
    return [
        wanted.judge(f"{label}: {figure}", results.values(results.recordings[0], label, figure))
        for label in results.contenders
        for of, held_to in TARGETS.items()
        if re.fullmatch(of, label)
        for figure, wanted in held_to.items()
    ]


def _report(results: Results, ready: Ready) -> Report:
    (name,), own, winkler = results.recordings, results.contenders[0], key(ONE_STEP, "Winkler, K")
    kalman = [label for label in results.contenders if re.fullmatch("[EU]KF paper.*", label)]
    best = min(kalman, key=lambda label: results.mean(name, label, winkler))
    case = next(iter(ready.cases.values()))
    worst, learners = PUBLISHED["h_infinity"], [one for one in results.contenders if "true parameters" not in one]
    alpha = PUBLISHED["median_alpha"].values()
    document = Document(__package__)
    lead = document.lines(
        "Lead",
        own=own,
        inside=100 * results.mean(name, own, key(ONE_STEP, "coverage")),
        best=best,
        score=results.spread(name, own, winkler),
        floor=results.spread(name, building.KNOWING, winkler),
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
        targets(verdicts(results), "docs/experiments.md says why some are missed."),
        document.section(
            "Can the intervals be trusted?",
            *(
                results.table(f"calibration-{one.replace('_', '-')}", _calibration(one), quoted=PUBLISHED[one])
                for one in (ONE_STEP, FILTERED)
            ),
        ),
        document.section(
            "Has it learned the building?",
            results.table(
                "transfer-function-errors",
                [f"{norm} {channel}" for norm in ("H2", "H∞") for channel in CHANNELS.values()],
                contenders=learners,
                quoted={label: (*h2, *worst.get(label, (None,) * len(h2))) for label, h2 in PUBLISHED["h2"].items()},
            ),
            results.table("open-loop", _OPEN_LOOP, quoted=PUBLISHED["open_loop"]),
        ),
        document.section(
            "Does it notice what it cannot see?",
            results.table(
                "parasitic-learning",
                _NOTICED,
                contenders=learners,
                quoted={
                    label: (None, None, index, *(alpha if label.startswith("RBPF") else (None, None)), None, None)
                    for label, index in PUBLISHED["parasitic_learning"].items()
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
    columns |= {regime: key(convention, "coverage", regime) for regime in (building.LOW, building.DOMINATED)}
    return columns | {"width, K": key(convention, "width, K")}


_OPEN_LOOP = {name: f"open loop, {name}" for name in ("mean", "median", "smallest", "largest")}
_NOTICED = (
    *("median update, quiet", "median update, disturbed", building.INDEX),
    *("median alpha, quiet", "median alpha, disturbed", building.AUC, "AUC, settled"),
)
_CAUSES = (
    "AUC, one sample later",
    *(f"{of}, {third} third" for of in ("median update", "index") for third in ("first", "last")),
)
