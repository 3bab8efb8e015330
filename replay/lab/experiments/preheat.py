"""`preheat`: is a room warm in time, and not much too early, when the heating starts as Thermogate says? Buildings of
EnergyPlus under relays live, after two weeks, with the latest start that each room is told at midnight."""

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.energyplus.plant import STEP
from replay.experiments.jobs import Arrays
from replay.experiments.request import Request
from replay.experiments.study import Figures, Results, Study
from replay.lab.experiments.control.loop import Moment, close
from replay.lab.experiments.relays import Learning, RelayRun, report, study
from replay.localtime import DAY, HOUR
from replay.reports.kit.report import Report
from service.errors import NoLaw
from service.forecast.foresight import NO_WEATHER
from service.forecast.heating import SWING, PreheatQuestion

PROBABILITY, TOLERANCE = 0.9, 0.5
MORNINGS, STARTS, IN_TIME, BEEN, PROMISED, EARLY = (
    *("mornings", "with a start", "in time", "warm in the 2 h before", "promised"),
    "min too early, median",
)
_LATELY = round(SWING / STEP)
"""Steps in which a room counts as warm that has been so, as in the answer."""


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
    return study(request, mornings, _figures, _report)


class Asking(Learning):
    """Set-points of the people, raised when Thermogate says."""

    def __init__(self, run: RelayRun) -> None:
        super().__init__(run)
        self.asked: list[_Question] = []
        self._from = run.asked_from

    def set_points(self, moment: Moment) -> Array:
        wanted = super().set_points(moment)
        for room in range(len(wanted)) if moment.local % DAY == 0 and moment.step >= self._from else ():
            self._ask(room, moment)
        for one in self.asked:
            if one.step <= moment.step < one.by:
                use = self.building.rooms[one.room].use
                wanted[one.room] = use.by_day if moment.step >= one.start else use.by_night
        return wanted

    def _ask(self, room: int, moment: Moment) -> None:
        """Nothing where nobody wants it warm on that day, or nothing is known of the thermostat."""
        use = self.building.rooms[room].use
        ahead = use.warm[0] * HOUR
        if use.set_point(moment.local + ahead) != use.by_day:
            return
        question, found = PreheatQuestion(use.by_day, moment.time + ahead, PROBABILITY, TOLERANCE), None
        # In a short run a room may have no law yet.
        with suppress(NoLaw):
            found = question(self.workers[room], NO_WEATHER, lambda: False)
        if found is not None:
            here = moment.step
            start = here if found.start is None else here + round((found.start - moment.time) / STEP)
            by = here + round(ahead / STEP)
            self.asked.append(_Question(room, here, start, by, found.start is not None, found.reached))


def mornings(run: RelayRun) -> Arrays:
    """By morning of each room, (M,): `told`, whether there was a start; `promised`, the probability; `warm`, whether
    the room was warm in time, and `lately`, whether it was after the start and in the 2 h before; `early` [min], how
    long before it was warm first after the start, NaN where it never was."""
    scene, asking = run.scene, Asking(run)
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
        "lately": np.array(
            [(air[max(one.start, one.by - _LATELY) : one.by + 1, one.room] >= warm[one.room]).any() for one in asked]
        ),
        "early": np.array(early),
    }


def _figures(arrays: Arrays) -> Figures:
    known = arrays["early"][np.isfinite(arrays["early"])]
    shares = {STARTS: "told", IN_TIME: "warm", BEEN: "lately", PROMISED: "promised"}
    figures = {name: float(arrays[key].mean()) for name, key in shares.items()}
    early = float(np.median(known)) if len(known) else np.nan
    return {MORNINGS: float(len(arrays["told"])), EARLY: early} | figures


def _report(results: Results) -> Report:
    figures, told = (MORNINGS, STARTS, IN_TIME, BEEN, PROMISED, EARLY), {"in_time": IN_TIME, "mornings": MORNINGS}
    return report("preheat", results, figures, told | {"early": EARLY}, asked=PROBABILITY, tolerance=TOLERANCE)
