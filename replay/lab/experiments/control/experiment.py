"""`control`: buildings of EnergyPlus in five cases, each under every controller."""

from replay.energyplus.buildings import building_named
from replay.energyplus.library import library
from replay.errors import ReplayError
from replay.experiments.jobs import Job
from replay.experiments.request import Request
from replay.experiments.study import Study
from replay.lab.experiments.control.cases import CASES, START, UNDISTURBED, Scene
from replay.lab.experiments.control.controllers import EARLY
from replay.lab.experiments.control.report import figures, report
from replay.lab.experiments.control.runs import CONTROLLERS, PERFECT, THERMOSTAT, ControlRun, run_control, with_example
from replay.lab.experiments.control.scores import Scores

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


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError where it cannot be made, EnergyPlusMissing without the extra."""
    request.accept("seeds", "days", "building", "case")
    library()
    days = request.days or DAYS
    if days < 3:
        raise ReplayError(f"--days {days}: a third of them is history and the rest is controlled; give 3 or more")
    buildings = [building_named(name).name for name in request.building or USUAL]
    cases = [_case(name) for name in request.case or CASES]
    controlled = days - days // 3
    every = [
        Scene(building, WEATHER[building], case, seed, controlled if case == START else days, controlled)
        for building in buildings
        for case in cases
        for seed in request.seeds_or(SEEDS)
    ]
    jobs = [
        Job(named(scene), setting(run), scene.seed, run_control, with_example(run))
        for scene in every
        for run in _runs(scene)
    ]
    scenes = {named(scene): scene for scene in reversed(every)}
    return Study(
        jobs,
        lambda _, arrays: figures(Scores(*arrays["scores"].tolist())),
        lambda results: report(results, {name: scenes[name] for name in results.recordings}, every),
    )


def named(scene: Scene) -> str:
    return f"{scene.building}, {scene.case}"


def setting(run: ControlRun) -> str:
    """The controller, and its setting where that is not the usual one."""
    usual = ControlRun(run.scene, run.controller)
    return run.controller if run == usual else f"{run.controller} {run.margin:+.2f} K {run.early / 60:.0f} min"


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
