"""The report of the control experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from replay.experiments.study import Figures, Results, targets
from replay.lab.experiments.control.cases import CASES, PRICES, UNDISTURBED, WARMEST, Scene
from replay.lab.experiments.control.front import share_of_the_way
from replay.lab.experiments.control.perfect import PASSES
from replay.lab.experiments.control.runs import CONTROLLERS, ESTIMATOR, PERFECT, THERMOGATE, THERMOSTAT, UNTRUSTING
from replay.lab.experiments.control.scores import Scores
from replay.reports.kit.report import Report, Section
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


def figures(scores: Scores) -> Figures:
    """The figures of a run."""
    return {**scores._asdict(), DISCOMFORT: scores.discomfort}


def report(results: Results, scenes: Mapping[str, Scene], every: Sequence[Scene]) -> Report:
    """The report; `scenes` has one scene of each recording, a building in a case, and `every` those of all seeds."""
    return Report(
        "The loop closed",
        tuple(_lead(results, name, scene) for name, scene in scenes.items()),
        (
            _done(every),
            targets(verdicts(results, scenes), "They are meant for four controlled weeks."),
            *(
                Section(name, (CASES[scene.case].what,), (_table(results, name, scene),))
                for name, scene in scenes.items()
            ),
        ),
    )


def shares(results: Results, recording: str, controller: str) -> list[float]:
    """For every seed, how far a controller is on the way from the thermostat to perfect knowledge.

    Both are swept: each contender whose label begins with theirs is the same controller with another setting. NaN where
    they ran with one setting only.
    """
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
    """Every target of Thermogate's controller."""
    found = []
    for name, scene in scenes.items():
        if scene.case == UNDISTURBED:
            target = f"{name}: share of the way from thermostat to perfect knowledge, cost at equal discomfort"
            found.append(at_least(target, shares(results, name, THERMOGATE), OF_THE_WAY))
            continue
        own = results.values(name, THERMOGATE, DISCOMFORT)
        for label, said in ((THERMOSTAT, "that of the thermostat"), (UNTRUSTING, "that without trust")):
            others = results.values(name, label, DISCOMFORT)
            ratios = [mine / max(its, 1e-9) for mine, its in zip(own, others, strict=True)]
            found.append(at_most(f"{name}: discomfort over {said}", ratios, 1.0))
    return found


def _lead(results: Results, name: str, scene: Scene) -> str:
    own, thermostat = (
        tuple(results.mean(name, label, figure) for figure in ("cost", DISCOMFORT))
        for label in (THERMOGATE, THERMOSTAT)
    )
    text = (
        f"{name}: Thermogate's controller pays {own[0]:.1f} at a discomfort of {own[1]:.1f} K h, the thermostat "
        f"{thermostat[0]:.1f} at {thermostat[1]:.1f} K h"
    )
    share = spread(shares(results, name, THERMOGATE)).mean if scene.case == UNDISTURBED else np.nan
    return (
        f"{text}; at equal discomfort that is {share:.0%} of the way to perfect knowledge."
        if share == share
        else (f"{text}.")
    )


def _done(scenes: Sequence[Scene]) -> Section:
    buildings = {scene.building: scene for scene in scenes}
    listed = "; ".join(f"{scene.building}: {scene.of.what}, weather of {scene.weather}" for scene in buildings.values())
    cases, seeds = {scene.case for scene in scenes}, dict.fromkeys(scene.seed for scene in scenes)
    history = max(scene.days - scene.controlled for scene in scenes)
    tariff = ", ".join(f"{name} {price:.2f}" for name, price in PRICES.items())
    return Section(
        "What was done",
        (
            f"Buildings: {listed}. A thermostat heats for {history} days, then each controller for "
            f"{scenes[0].controlled} days, which are scored. Seeds {', '.join(map(str, seeds))}, of people, "
            "thermometers and estimators. EnergyPlus steps every 5 min; thermometers have a noise of 0.03 K.",
            *(f"{name}: {CASES[name].what}" for name in CASES if name in cases),
            f"A kWh costs by tariff: {tariff}. Comfort is from the set-point of the room, which is lowered at night, "
            f"to {WARMEST:.0f} degC; discomfort is what the exact temperature of each room lies outside, in K h.",
            f"Thermogate is `{ESTIMATOR}` with its defaults. Who the controllers are, what perfect knowledge is "
            f"({PASSES} passes over the same period), and what cost at equal discomfort means: docs/experiments.md.",
        ),
    )


def _table(results: Results, name: str, scene: Scene) -> Table:
    swept = scene.case == UNDISTURBED
    rows: list[tuple[Cell, ...]] = []
    for label in CONTROLLERS:
        cells: list[Cell] = [results.spread(name, label, figure) for figure in _COLUMNS.values()]
        if any(cell is not None for cell in cells):
            known = swept and label not in (THERMOSTAT, PERFECT)
            cells += [spread(shares(results, name, label)) if known else None] if swept else []
            rows.append((label, *cells))
    return Table(
        name.replace(",", "").replace(" ", "-"),
        f"{name}: every controller at its usual setting",
        ("controller", *_COLUMNS, *(("share of the way",) if swept else ())),
        tuple(rows),
        "Mean over seeds ± standard deviation."
        + (
            " Share of the way from the thermostat to perfect knowledge in cost, at the controller's own discomfort."
            if swept
            else ""
        ),
    )
