"""`preheat`: is a room warm in time, and not much too early, when the heating starts as Thermogate says?

Buildings of EnergyPlus under relays. After two weeks each room is asked at midnight for the latest start that is in
time with probability PROBABILITY, and the building then lives with that start.
"""

from contextlib import suppress
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
from replay.lab.experiments.control.cases import UNDISTURBED, Scene
from replay.lab.experiments.control.experiment import USUAL, WEATHER
from replay.lab.experiments.control.loop import Controller, Moment, close
from replay.lab.experiments.control.site import inputs_of, networks_of
from replay.localtime import DAY, HOUR
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.scores.intervals import Mask
from service.config.fitting import known_heat
from service.errors import NoLaw
from service.forecast.heating import PreheatQuestion
from service.records.sample import Sample
from service.zone.foresight.outlook import NO_WEATHER
from service.zone.worker import WorkerSettings, ZoneWorker

PERIOD = 900
"""s of a sample; a relay looks every STEP s."""
LEARNED = 14
"""Days before the first question, or half of a shorter run."""
DAYS = 42
PROBABILITY, TOLERANCE = 0.9, 0.5
MORNINGS, STARTS, IN_TIME, BEEN, PROMISED, EARLY = (
    *("mornings", "with a start", "in time", "warm once by then", "promised"),
    "min too early, median",
)


class PreheatRun(NamedTuple):
    """What a run depends on."""

    building: str
    estimator: str
    seed: int
    days: int


class _Question(NamedTuple):
    """A room's morning: `step` of the plant at which it was asked, those at which to start and to be warm, and whether
    a start was told; the probability promised."""

    room: int
    step: int
    start: int
    by: int
    told: bool
    promised: float


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError where it cannot be made, EnergyPlusMissing without the extra."""
    request.accept("seeds", "days", "building")
    library()
    days = request.days or DAYS
    if days < 4:
        raise ReplayError(f"--days {days}: nothing can be asked before a law is known; give 4 or more")
    runs = [
        PreheatRun(building_named(name).name, "bank", seed, days)
        for name in request.building or USUAL
        for seed in request.seeds_or(1)
    ]
    return Study(
        tuple(Job(run.building, run.estimator, run.seed, mornings, run) for run in runs),
        lambda run, arrays: _figures(arrays),
        _report,
    )


class Asking(Controller):
    """Relays keep the set-points of the people, raised when Thermogate says; a worker of each room learns."""

    def __init__(self, run: PreheatRun, scene: Scene) -> None:
        self.asked: list[_Question] = []
        self._building, self._life = scene.of, scene.life()
        self._networks = list(networks_of(scene.of, scene.whereabouts.location).values())
        self._relay = OnOff(np.array([room.heater for room in scene.of.rooms]))
        self._learned = min(LEARNED, run.days // 2) * DAY // STEP
        settings = WorkerSettings(run.seed, (0.95,), 12, PERIOD)
        made = [registry.build(run.estimator, network, PERIOD, {}) for network in self._networks]
        self._workers = [ZoneWorker(one, settings, known_heat(one.network, PERIOD, scene.whereabouts)) for one in made]
        self._wanted = np.empty(0)
        self._steps: list[tuple[Moment, Array, Array]] = []

    def powers(self, moment: Moment) -> tuple[Array, Mask]:
        """Of the relays; every room is asked at midnight."""
        wanted = self._life.set_points(moment.local)
        for room in range(len(wanted)) if moment.local % DAY == 0 and moment.step >= self._learned else ():
            self._ask(room, moment)
        for one in self.asked:
            if one.step <= moment.step < one.by:
                use = self._building.rooms[one.room].use
                wanted[one.room] = use.by_day if moment.step >= one.start else use.by_night
        self._wanted = wanted
        return self._relay(moment.local, moment.shown, wanted), np.zeros(len(wanted), dtype=np.bool_)

    def saw(self, moment: Moment, heating: Array, outdoor: float, irradiance: float) -> None:
        """A sample of every room at the end of each PERIOD."""
        self._steps.append((moment, self._wanted, np.array([outdoor, irradiance, *heating])))
        if len(self._steps) < PERIOD // STEP:
            return
        began, wanted, _ = self._steps[0]
        outdoor, irradiance, *powers = np.mean([acting for *_, acting in self._steps], axis=0)
        for index, (worker, network) in enumerate(zip(self._workers, self._networks, strict=True)):
            inputs = inputs_of(self._building, index, network, began.shown, outdoor, irradiance, np.array(powers))
            sample = Sample.measured(began.time, began.shown[index : index + 1], inputs)
            worker.step(sample._replace(setpoint=float(wanted[index])))
        self._steps = []

    def _ask(self, room: int, moment: Moment) -> None:
        """Nothing where nobody wants it warm on that day, or nothing is known of the thermostat."""
        use = self._building.rooms[room].use
        ahead = use.warm[0] * HOUR
        if use.set_point(moment.local + ahead) != use.by_day:
            return
        question, found = PreheatQuestion(use.by_day, moment.time + ahead, PROBABILITY, TOLERANCE), None
        # In a short run a room may have no law yet.
        with suppress(NoLaw):
            found = question(self._workers[room], NO_WEATHER, lambda: False)
        if found is not None:
            here = moment.step
            start = here if found.start is None else here + round((found.start - moment.time) / STEP)
            by = here + round(ahead / STEP)
            self.asked.append(_Question(room, here, start, by, found.start is not None, found.reached))


def mornings(run: PreheatRun) -> Arrays:
    """By morning of each room, (M,): `told`, whether there was a start; `promised`, the probability; `warm`, whether
    the room was warm in time; `early` [min], how long before it was warm first after the start, NaN where it never was.
    """
    scene = Scene(run.building, WEATHER[run.building], UNDISTURBED, run.seed, run.days, run.days)
    asking = Asking(run, scene)
    air = close(scene, asking).air
    asked = [one for one in asking.asked if one.by < len(air)]
    warm = np.array([room.use.by_day for room in scene.of.rooms]) - TOLERANCE
    since = [np.flatnonzero(air[one.start : one.by + 1, one.room] >= warm[one.room]) for one in asked]
    early = [
        (one.by - one.start - each[0]) * STEP / 60 if len(each) else np.nan
        for one, each in zip(asked, since, strict=True)
    ]
    return {
        "told": np.array([one.told for one in asked]),
        "promised": np.array([one.promised for one in asked]),
        "warm": np.array([air[one.by, one.room] >= warm[one.room] for one in asked]),
        "early": np.array(early),
    }


def _figures(arrays: Arrays) -> Figures:
    known = arrays["early"][np.isfinite(arrays["early"])]
    shares = {STARTS: "told", IN_TIME: "warm", PROMISED: "promised"}
    figures = {name: float(arrays[key].mean()) for name, key in shares.items()}
    early = float(np.median(known)) if len(known) else np.nan
    counts = {MORNINGS: float(len(arrays["told"])), BEEN: len(known) / max(1, len(arrays["told"]))}
    return counts | {EARLY: early} | figures


def _report(results: Results) -> Report:
    document = Document(__package__, "preheat.md")
    lead = [
        line
        for name in results.recordings
        for line in document.lines(
            "Lead",
            name=name,
            asked=PROBABILITY,
            in_time=results.mean(name, "bank", IN_TIME),
            mornings=results.mean(name, "bank", MORNINGS),
            early=results.mean(name, "bank", EARLY),
        )
    ]
    done = document.section("What was done", tolerance=TOLERANCE, period=PERIOD // 60)
    table = results.table("preheat", (MORNINGS, STARTS, IN_TIME, BEEN, PROMISED, EARLY))
    return Report(document.title, tuple(lead), (done, document.section("What came out", table)))
