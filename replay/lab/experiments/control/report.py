"""The report of the control experiment."""

from collections.abc import Mapping, Sequence

import numpy as np

from replay.experiments.study import Figures, Results, targets
from replay.lab.experiments.control.cases import CASES, PRICES, UNDISTURBED, WARMEST, Scene
from replay.lab.experiments.control.perfect import PASSES
from replay.lab.experiments.control.runs import CONTROLLERS, ESTIMATOR, PERFECT, THERMOGATE, THERMOSTAT, UNTRUSTING
from replay.lab.experiments.control.scores import Scores, share_of_the_way
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.reports.kit.table import Cell, Table, spread
from replay.reports.kit.verdict import Verdict, at_least, at_most

OF_THE_WAY = 0.8
"""Target of Thermogate's controller: its share of the way from the thermostat to perfect knowledge."""
DISCOMFORT = "discomfort, K h"
_COLUMNS = {
    "energy, kWh": "energy",
    "cost": "cost",
    "too cold, K h": "cold",
    "too warm, K h": "warm",
    DISCOMFORT: DISCOMFORT,
    "peak, kW": "peak",
    "switched on, per room and day": "switches",
    "share of time under a thermostat": "fallback",
}
_COMPARED = (THERMOGATE, THERMOSTAT)
_ON_THE_WAY = [label for label in CONTROLLERS if label not in (THERMOSTAT, PERFECT)]


def figures(scores: Scores) -> Figures:
    return {**scores._asdict(), DISCOMFORT: scores.discomfort}


def report(results: Results, scenes: Mapping[str, Scene], every: Sequence[Scene]) -> Report:
    """The report; `scenes` has one scene of each recording, a building in a case, and `every` those of all seeds."""
    document, lead = Document(__package__), list[str]()
    for name in scenes:
        ours, usual = ({of: results.spread(name, label, of) for of in ("cost", DISCOMFORT)} for label in _COMPARED)
        figures = {"cost": ours["cost"], "discomfort": ours[DISCOMFORT]}
        lead += document.lines("Lead", name=name, **figures, usual=usual["cost"], uncomfortable=usual[DISCOMFORT])
    rows: list[tuple[Cell, ...]] = [
        (name, *(spread(found) if (found := shares(results, name, label)) else None for label in _ON_THE_WAY))
        for name, scene in scenes.items()
        if scene.case == UNDISTURBED
    ]
    buildings, cases = {scene.building: scene for scene in every}, {scene.case for scene in every}
    done = document.section(
        "What was done",
        buildings="; ".join(f"{name}: {one.of.what}, weather of {one.weather}" for name, one in buildings.items()),
        history=max(scene.days - scene.controlled for scene in every),
        controlled=every[0].controlled,
        seeds=", ".join(map(str, dict.fromkeys(scene.seed for scene in every))),
        cases=" ".join(f"{name}: {text}" for name, text in CASES.items() if name in cases),
        tariff=", ".join(f"{name} {price:.2f}" for name, price in PRICES.items()),
        warmest=WARMEST,
        estimator=ESTIMATOR,
        passes=PASSES,
    )
    came_out = document.section(
        "What came out",
        Table("share-of-the-way", ("recording", *_ON_THE_WAY), tuple(rows)) if rows else None,
        results.table("controllers", _COLUMNS, contenders=CONTROLLERS, heading="controller"),
    )
    target = targets(verdicts(results, scenes), "They are meant for four controlled weeks.")
    return Report(document.title, tuple(lead), (done, target, came_out))


def shares(results: Results, recording: str, controller: str) -> list[float]:
    """For every seed, how far a controller is on the way from the thermostat to perfect knowledge, both swept over the
    settings of contenders whose labels begin with theirs; NaN where they ran with one setting only."""
    found = []
    for seed, own in enumerate(results.runs(recording, controller)):
        thermostat, perfect = (_swept(results, recording, label, seed) for label in (THERMOSTAT, PERFECT))
        known = len(thermostat) > 1 and len(perfect) > 1
        found.append(share_of_the_way(_scores(own), thermostat, perfect) if known else np.nan)
    return found


def _swept(results: Results, recording: str, controller: str, seed: int) -> list[Scores]:
    labels = [label for label in results.contenders if label.startswith(controller)]
    return [_scores(runs[seed]) for label in labels if (runs := results.runs(recording, label))]


def _scores(found: Figures) -> Scores:
    return Scores(*(found[name] for name in Scores._fields))


def verdicts(results: Results, scenes: Mapping[str, Scene]) -> list[Verdict]:
    found = []
    for name, scene in scenes.items():
        if scene.case == UNDISTURBED:
            target = f"{name}: share of the way from thermostat to perfect knowledge, cost at equal discomfort"
            found.append(at_least(OF_THE_WAY).judge(target, shares(results, name, THERMOGATE)))
            continue
        own = results.values(name, THERMOGATE, DISCOMFORT)
        for label, said in ((THERMOSTAT, "that of the thermostat"), (UNTRUSTING, "that without trust")):
            others = results.values(name, label, DISCOMFORT)
            ratios = [mine / max(its, 1e-9) for mine, its in zip(own, others, strict=True)]
            found.append(at_most(1.0).judge(f"{name}: discomfort over {said}", ratios))
    return found
