"""Relays in a building of EnergyPlus, which keep the set-points of its people, and zones that learn beside them."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator import registry
from estimator.arrays import Array
from replay.energyplus.buildings import building_named
from replay.energyplus.heating import OnOff
from replay.energyplus.library import library
from replay.energyplus.plant import STEP
from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job
from replay.experiments.request import Request
from replay.experiments.study import Figures, Results, Study
from replay.lab.experiments.control.cases import STEPS_A_DAY, UNDISTURBED, Scene
from replay.lab.experiments.control.experiment import USUAL, WEATHER
from replay.lab.experiments.control.loop import Controller, Moment
from replay.lab.experiments.control.site import inputs_of, networks_of
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.scores.intervals import Mask
from service.config.fitting import known_heat
from service.records.sample import Sample
from service.zone.worker import WorkerSettings, ZoneWorker

PERIOD = 900
"""s of a sample; a relay looks every STEP s."""
LEARNED = 14
"""Days before the first question, or half of a shorter run."""
DAYS = 42


class RelayRun(NamedTuple):
    building: str
    estimator: str
    seed: int
    days: int

    @property
    def scene(self) -> Scene:
        return Scene(self.building, WEATHER[self.building], UNDISTURBED, self.seed, self.days, self.days)

    @property
    def asked_from(self) -> int:
        """The first step of the plant at which something is asked."""
        return min(LEARNED, self.days // 2) * STEPS_A_DAY


def study(
    request: Request,
    live: Callable[[RelayRun], Arrays],
    figures: Callable[[Arrays], Figures],
    report: Callable[[Results], Report],
) -> Study:
    """An experiment in which `live` asks a bank; ReplayError for a `request` that does not fit, EnergyPlusMissing
    without the extra."""
    request.accept("seeds", "days", "building")
    library()
    days = request.days or DAYS
    if days < 4:
        raise ReplayError(f"--days {days}: nothing can be asked before a law is known; give 4 or more")
    runs = [
        RelayRun(building_named(name).name, "bank", seed, days)
        for name in request.building or USUAL
        for seed in request.seeds_or(1)
    ]
    jobs = tuple(Job(run.building, run.estimator, run.seed, live, run) for run in runs)
    return Study(jobs, lambda run, arrays: figures(arrays), report)


def report(name: str, results: Results, figures: Sequence[str], told: Mapping[str, str], **given: object) -> Report:
    """The report of the experiment `name`: a table of `figures`, and its document, which is `given` values, and in the
    Lead of every building the means of the figures that `told` names."""
    document, lead = Document(__package__, f"{name}.md"), list[str]()
    for building in results.recordings:
        means = {value: results.mean(building, "bank", figure) for value, figure in told.items()}
        lead += document.lines("Lead", name=building, **means, **given)
    done = document.section("What was done", period=PERIOD // 60, **given)
    came = document.section("What came out", results.table(name.replace("_", "-"), figures))
    return Report(document.title, tuple(lead), (done, came))


class Relays(Controller):
    """Relays keep what `set_points` gives them."""

    def __init__(self, scene: Scene) -> None:
        self.building, self.life = scene.of, scene.life()
        self._relay = OnOff(np.array([room.heater for room in scene.of.rooms]))
        self._wanted = np.empty(0)

    def set_points(self, moment: Moment) -> Array:
        """(N,) degC from `moment` on: those of the people."""
        return np.array(self.life.set_points(moment.local))

    def powers(self, moment: Moment) -> tuple[Array, Mask]:
        self._wanted = self.set_points(moment)
        return self._relay(moment.local, moment.shown, self._wanted), np.zeros(len(self._wanted), dtype=np.bool_)


class Learning(Relays):
    """A worker of each room learns beside them."""

    def __init__(self, run: RelayRun) -> None:
        scene = run.scene
        super().__init__(scene)
        self._networks = list(networks_of(scene.of, scene.whereabouts.location).values())
        settings = WorkerSettings(run.seed, (0.95,), 12, PERIOD)
        made = [registry.build(run.estimator, network, PERIOD, {}) for network in self._networks]
        self.workers = [ZoneWorker(one, settings, known_heat(one.network, PERIOD, scene.whereabouts)) for one in made]
        self._steps: list[tuple[Moment, Array, Array]] = []

    def saw(self, moment: Moment, heating: Array, outdoor: float, irradiance: float) -> None:
        self._steps.append((moment, self._wanted, np.array([outdoor, irradiance, *heating])))
        if len(self._steps) < PERIOD // STEP:
            return
        began, wanted, _ = self._steps[0]
        outdoor, irradiance, *powers = np.mean([acting for *_, acting in self._steps], axis=0)
        for index, (worker, network) in enumerate(zip(self.workers, self._networks, strict=True)):
            inputs = inputs_of(self.building, index, network, began.shown, outdoor, irradiance, np.array(powers))
            sample = Sample.measured(began.time, began.shown[index : index + 1], inputs)
            worker.step(sample._replace(setpoint=float(wanted[index])))
        self._steps = []
