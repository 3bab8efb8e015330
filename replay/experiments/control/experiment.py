"""`control`: buildings of EnergyPlus in four cases, each under every controller."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

from replay.energyplus.buildings import building_named
from replay.energyplus.library import library
from replay.errors import ReplayError
from replay.experiments.control.cases import CASES, UNDISTURBED, Scene
from replay.experiments.control.controllers import EARLY
from replay.experiments.control.customer import mpc
from replay.experiments.control.outcome import Outcome, seen_of
from replay.experiments.control.report import report
from replay.experiments.control.runs import CONTROLLERS, PERFECT, THERMOSTAT, ControlRun, control_job, lived_of
from replay.experiments.control.scores import Scores
from replay.experiments.jobs import Arrays, Job
from replay.experiments.report import Report
from replay.experiments.request import Request

WEATHER = {"timber": "denver", "house": "chicago", "office": "chicago"}
USUAL = ("timber", "house")
DAYS = 42
"""Six weeks, the first third of which is history."""
SEEDS = 1
"""Of people, thermometers and estimators."""

MARGINS = (-0.3, 0.3, 0.6)
"""K above the band that thermostat and perfect knowledge are also run with, in the case that is compared by cost."""
EARLIER = (0.0, 2.0 * EARLY)
"""s by which the thermostat is also set up before the night setback ends."""


class Control:
    """The experiment, made ready."""

    def __init__(self, request: Request) -> None:
        request.accept("seeds", "days", "building", "case")
        library()
        mpc()
        self._days = request.days or DAYS
        if self._days < 3:
            raise ReplayError(
                f"--days {self._days}: a third of them is history and the rest is controlled; give 3 or more"
            )
        self._seeds = request.seeds_or(SEEDS)
        self._buildings = [building_named(name).name for name in request.building or USUAL]
        self._cases = [_case(name) for name in request.case or CASES]

    def jobs(self) -> list[Job]:
        """Building by building, case by case, seed by seed."""
        return [control_job(run) for runs in self._planned() for run in runs]

    def report(self, results: Sequence[Arrays]) -> Report:
        """Scores, verdicts, figures."""
        rest = iter(results)
        outcomes: dict[tuple[str, str], Outcome] = {}
        for runs in self._planned():
            scene = runs[0].scene
            found = [(Scores(*arrays["scores"].tolist()), lived_of(arrays)) for arrays in islice(rest, len(runs))]
            seen = seen_of(dict(zip(runs, found, strict=True)))
            before = outcomes.get((scene.building, scene.case), Outcome(scene, {}))
            outcomes[scene.building, scene.case] = before._replace(seen={**before.seen, scene.seed: seen})
        return report([*outcomes.values()], self._seeds)

    def _planned(self) -> Iterator[list[ControlRun]]:
        """The runs of one building, case and seed at a time; of each controller first the usual one."""
        for building in self._buildings:
            for case in self._cases:
                for seed in self._seeds:
                    controlled = self._days - self._days // 3
                    days = self._days if CASES[case].history else controlled
                    yield _runs(Scene(building, WEATHER[building], case, seed, days, controlled))


def _runs(scene: Scene) -> list[ControlRun]:
    found = [ControlRun(scene, controller) for controller in CONTROLLERS]
    if scene.case == UNDISTURBED:
        found += [ControlRun(scene, name, margin) for name in (THERMOSTAT, PERFECT) for margin in MARGINS]
        found += [ControlRun(scene, THERMOSTAT, early=early) for early in EARLIER]
    return found


def _case(name: str) -> str:
    if name not in CASES:
        raise ReplayError(f"there is no case '{name}'; the cases are {', '.join(CASES)}")
    return name


def prepare(request: Request) -> Control:
    """The experiment for `request`; ReplayError where it cannot be made, EnergyPlusMissing without the extra."""
    return Control(request)
