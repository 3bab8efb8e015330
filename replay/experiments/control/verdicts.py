"""What Thermogate's controller is held to, checked by the numbers of a run."""

from __future__ import annotations

from collections.abc import Sequence

from replay.experiments.control.cases import UNDISTURBED
from replay.experiments.control.outcome import Outcome
from replay.experiments.control.runs import THERMOGATE, THERMOSTAT, UNTRUSTING
from replay.experiments.verdict import Verdict, at_least, at_most

OF_THE_WAY = 0.8


def verdicts(outcomes: Sequence[Outcome]) -> list[Verdict]:
    """Every target."""
    found = []
    for outcome in outcomes:
        if outcome.scene.case == UNDISTURBED:
            target = f"{outcome.name}: share of the way from thermostat to perfect knowledge, cost at equal discomfort"
            found.append(at_least(target, outcome.shares(THERMOGATE), OF_THE_WAY))
            continue
        own, thermostat, untrusting = (
            outcome.figures(label, lambda one: one.discomfort) for label in (THERMOGATE, THERMOSTAT, UNTRUSTING)
        )
        found.append(at_most(f"{outcome.name}: discomfort over that of the thermostat", _ratios(own, thermostat), 1.0))
        found.append(at_most(f"{outcome.name}: discomfort over that without trust", _ratios(own, untrusting), 1.0))
    return found


def _ratios(own: Sequence[float], other: Sequence[float]) -> list[float]:
    return [mine / max(its, 1e-9) for mine, its in zip(own, other, strict=True)]
