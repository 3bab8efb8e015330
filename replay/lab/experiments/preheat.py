"""`preheat`: is a room warm in time, and not much too early, when the heating starts as Thermogate says?

Buildings of EnergyPlus under relays. After two weeks each room is asked at midnight for the latest start that is in
time with probability PROBABILITY, and the building then lives with that start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator import registry
from estimator.arrays import Array
from replay.energyplus.buildings import building_named
from replay.energyplus.heating import OnOff
from replay.energyplus.library import library
from replay.energyplus.people import Life
from replay.energyplus.plant import STEP, Inputs, Plant
from replay.energyplus.recording import THERMOMETER
from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job
from replay.experiments.request import Request
from replay.experiments.study import Figures, Results, Run, Study
from replay.lab.experiments.control.experiment import USUAL, WEATHER
from replay.lab.experiments.control.loop import BEGIN
from replay.lab.experiments.control.site import HEATER, adjacent, networks_of
from replay.localtime import DAY, HOUR
from replay.reports.kit.report import Report, Section
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
MORNINGS, STARTS, IN_TIME, PROMISED, EARLY = "mornings", "with a start", "in time", "promised", "min too early, median"


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
    jobs = [Job(f"{run.building} {run.estimator}", run.seed, mornings, run) for run in runs]
    return Study(
        tuple(Run(run.building, run.estimator, job) for run, job in zip(runs, jobs, strict=True)),
        lambda run, arrays: _figures(arrays),
        _report,
    )


def mornings(run: PreheatRun) -> Arrays:
    """By morning of each room, (M,): `told`, whether there was a start; `promised`, the probability; `warm`, whether
    the room was warm in time; `early` [min], how long before it was warm first after the start, NaN where it never was.
    """
    building, rng = building_named(run.building), np.random.default_rng([run.seed, 0x9E4])
    networks, rooms, learned = networks_of(building), building.rooms, min(LEARNED, run.days // 2)
    life, relay = Life([room.use for room in rooms], STEP, run.seed), OnOff(np.array([room.heater for room in rooms]))
    settings = WorkerSettings(run.seed, (0.95,), 12, PERIOD)
    workers = [ZoneWorker(registry.build(run.estimator, networks[room.name], PERIOD, {}), settings) for room in rooms]
    air: list[Array] = []
    asked: list[_Question] = []
    with Plant(building, WEATHER[run.building], begin=BEGIN) as plant:
        while len(air) < run.days * DAY // STEP:
            began, here, midnight = plant.now, len(air), plant.local_time % DAY == 0
            if midnight and here >= learned * DAY // STEP:
                asked += [each for room in range(len(rooms)) for each in _asked(workers, plant, life, room, here)]
            wanted = life.set_points(plant.local_time)
            for one in asked:
                if one.step <= here < one.by:
                    use = rooms[one.room].use
                    wanted[one.room] = use.by_day if here >= one.start else use.by_night
            steps = []
            for _ in range(round(PERIOD / STEP)):
                now, local = plant.now, plant.local_time
                air.append(now.air)
                after = plant.step(Inputs(relay(local, now.air, wanted), *life.at(local)))
                steps.append([now.outdoor, after.facade, *after.truth.heating])
            outdoor, sun, *heating = np.mean(steps, axis=0).tolist()
            shown = THERMOMETER.noise_sd * rng.standard_normal(len(rooms)) + began.air
            for index, worker in enumerate(workers):
                beside = {adjacent(rooms[other].name): shown[other] for other in building.neighbours(index)}
                values = {"T_out": outdoor, "I_sol": sun, HEATER: heating[index]} | beside
                inputs = np.array([values[name] for name in worker.network.inputs])
                sample = Sample.measured(round(began.time), shown[index : index + 1], inputs)
                worker.step(sample._replace(setpoint=float(wanted[index])))
    return _lived(asked, np.array(air), np.array([room.use.by_day for room in rooms]) - TOLERANCE)


def _asked(workers: list[ZoneWorker], plant: Plant, life: Life, room: int, here: int) -> list[_Question]:
    """The question of a room at midnight; none where nobody wants it warm on that day."""
    use = plant.building.rooms[room].use
    ahead = use.warm[0] * HOUR
    if use.set_point(plant.local_time + ahead) != use.by_day:
        return []
    by = plant.now.time + ahead
    found = PreheatQuestion(use.by_day, by, PROBABILITY, TOLERANCE)(workers[room], NO_WEATHER, lambda: False)
    if found is None:
        return []
    start = here if found.start is None else here + round((found.start - plant.now.time) / STEP)
    return [_Question(room, here, start, here + round(ahead / STEP), found.start is not None, found.reached)]


def _lived(asked: list[_Question], air: Array, warm: Array) -> Arrays:
    """The arrays of `mornings`, from the air (K, N) of the rooms, which are warm from `warm` (N,) on [degC]."""
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
    return {MORNINGS: float(len(arrays["told"])), EARLY: float(np.median(known)) if len(known) else np.nan} | figures


def _report(results: Results) -> Report:
    columns = {name: name for name in (MORNINGS, STARTS, IN_TIME, PROMISED, EARLY)}
    lead = tuple(
        f"{name}: asked for {PROBABILITY:.0%}, in time on {results.mean(name, 'bank', IN_TIME):.0%} of "
        f"{results.mean(name, 'bank', MORNINGS):.0f} mornings, {results.mean(name, 'bank', EARLY):.0f} min too early."
        for name in results.recordings
    )
    done = (
        "Relays keep the set-points of people who come, go and open windows. At midnight every room is asked when to "
        f"start, to be at most {TOLERANCE} K below its set-point when its day begins, and starts then, at once where "
        f"there is no start. A sample is {PERIOD // 60} min. Too early is the time since the room was warm first.",
    )
    advice = (
        "A higher `probability` starts earlier; one that the swing of the thermostat does not allow is not reached."
    )
    return Report(
        "When to start heating",
        lead,
        (
            Section("What was done", done),
            Section("What came out", (), (results.table("preheat", "Mornings", columns),)),
            Section("What to set", (advice,)),
        ),
    )
