"""`what-if`: is a day's heat as it was told, and would another plan have saved what was told? Buildings of EnergyPlus
under relays: after two weeks one room in turn is asked at midnight how much heat the day to come takes, and how much
less with set-points SETBACK lower. EnergyPlus lives the day both ways."""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.energyplus.plant import STEP
from replay.experiments.jobs import Arrays
from replay.experiments.request import Request
from replay.experiments.study import Figures, Results, Study
from replay.lab.experiments.control.cases import STEPS_A_DAY, Scene
from replay.lab.experiments.control.loop import Moment, close
from replay.lab.experiments.relays import PERIOD, Learning, RelayRun, Relays, report, study
from replay.localtime import DAY
from replay.reports.kit.report import Report
from replay.scores.intervals import rmse
from service.errors import NoLaw
from service.forecast.answers import Range
from service.forecast.foresight import NO_WEATHER
from service.forecast.heating import CompareQuestion, Course, DemandQuestion

SETBACK = 2.0
"""K."""
_KWH = 3.6e6
ASKED, DEMAND, DEMAND_COVERAGE, OFF, TRUE, SAVING, SAVING_OFF, SAVING_COVERAGE = (
    *("days asked", "demand, kWh a day", "coverage of the demand's interval", "error of the demand over yesterday's"),
    *("saving, kWh a day", "saving told", "rms error of the saving, kWh", "coverage of the saving's interval"),
)


class _Answer(NamedTuple):
    """What `room` was told at `step` of the plant: demand and difference, as (lower, mean, upper) in kWh."""

    room: int
    step: int
    demand: tuple[float, float, float]
    difference: tuple[float, float, float]


def prepare(request: Request) -> Study:
    return study(request, days_twice, _figures, _report)


class _Asking(Learning):
    """Asks one room at each midnight but the last; the set-points stay those of the people."""

    def __init__(self, run: RelayRun) -> None:
        super().__init__(run)
        self.answers: list[_Answer] = []
        self._from, self._until = run.asked_from, (run.days - 1) * STEPS_A_DAY

    def set_points(self, moment: Moment) -> Array:
        if moment.step % STEPS_A_DAY == 0 and self._from <= moment.step <= self._until:
            self._ask(moment.step // STEPS_A_DAY % len(self.workers), moment)
        return super().set_points(moment)

    def _ask(self, room: int, moment: Moment) -> None:
        worker, steps = self.workers[room], DAY // PERIOD
        usual = np.array([self.life.set_points(moment.local + PERIOD * k)[room] for k in range(steps)])
        try:
            called = DemandQuestion(steps, usual)(worker, NO_WEATHER, lambda: False)
            courses = (Course("usual", usual), Course("set back", usual - SETBACK))
            compared = CompareQuestion(steps, courses)(worker, NO_WEATHER, lambda: False)
        except NoLaw:
            # In a short run a room may have none yet.
            return
        if called is not None and compared is not None:
            told = _bounds(called.demand.total), _bounds(compared.differences[0].energy)
            self.answers.append(_Answer(room, moment.step, *told))


class _SetBack(Relays):
    """The day of one answer with the set-points that it was asked for."""

    def __init__(self, scene: Scene, answer: _Answer) -> None:
        super().__init__(scene)
        self._answer = answer

    def set_points(self, moment: Moment) -> Array:
        wanted = super().set_points(moment)
        if moment.step >= self._answer.step:
            wanted[self._answer.room] -= SETBACK
        return wanted


def days_twice(run: RelayRun) -> Arrays:
    """By day asked (Q,): `demand` and `difference` (Q, 3), told as lower end, mean and upper end; `took`, `before` and
    `differed`, what the day took, the day before, and the day set back took more. In kWh."""
    asking = _Asking(run)
    usual = close(run.scene, asking).heating
    took, before, differed = (np.empty(len(asking.answers)) for _ in range(3))
    for place, one in enumerate(asking.answers):
        scene = run._replace(days=one.step // STEPS_A_DAY + 1).scene
        instead = close(scene, _SetBack(scene, one)).heating
        took[place], before[place] = (_energy(usual, one, ago) for ago in (0, 1))
        differed[place] = _energy(instead, one, 0) - took[place]
    return {
        "demand": np.array([one.demand for one in asking.answers]),
        "difference": np.array([one.difference for one in asking.answers]),
        "took": took,
        "before": before,
        "differed": differed,
    }


def _energy(heating: Array, asked: _Answer, ago: int) -> float:
    """Of the day [kWh] that began so many days before the question, of `heating` (K, N) [W]."""
    begin = asked.step - ago * STEPS_A_DAY
    return float(heating[begin : begin + STEPS_A_DAY, asked.room].sum() * STEP / _KWH)


def _bounds(told: Range) -> tuple[float, float, float]:
    return told.lower, told.mean, told.upper


def _figures(arrays: Arrays) -> Figures:
    (low, mean, high), (least, less, most) = arrays["demand"].T, arrays["difference"].T
    took, differed = arrays["took"], arrays["differed"]
    return {
        ASKED: float(len(took)),
        DEMAND: float(took.mean()),
        DEMAND_COVERAGE: float(((low <= took) & (took <= high)).mean()),
        OFF: rmse(mean - took) / rmse(arrays["before"] - took),
        TRUE: float(-differed.mean()),
        SAVING: float(-less.mean()),
        SAVING_OFF: rmse(less - differed),
        SAVING_COVERAGE: float(((least <= differed) & (differed <= most)).mean()),
    }


def _report(results: Results) -> Report:
    figures = (ASKED, DEMAND, DEMAND_COVERAGE, OFF, TRUE, SAVING, SAVING_OFF, SAVING_COVERAGE)
    told = {"held": DEMAND_COVERAGE, "told": SAVING, "true": TRUE, "saved": SAVING_COVERAGE}
    return report("what_if", results, figures, told, setback=SETBACK)
