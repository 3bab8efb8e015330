"""A zone of the daemon, asked as its users ask it: nobody knows the heating to come."""

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.experiments.hours_ahead.forecasts import Forecasts, issued, no_forecasts
from replay.experiments.jobs import Arrays
from replay.experiments.series.filtering import FilterRun, built
from replay.scores.intervals import LEVEL
from service.errors import NoLaw
from service.forecast.engine import FanQuestion
from service.forecast.foresight import NO_WEATHER
from service.forecast.request import FEWEST_DRAWS, Detail
from service.records.fan import Fan
from service.records.outlook import SET_POINTS
from service.records.sample import Sample
from service.zone.worker import WorkerSettings, ZoneWorker

LIVE, SCHEDULED = "live", "scheduled"
WEATHER = " with weather"
ANSWERED = (LIVE, LIVE + WEATHER, SCHEDULED, SCHEDULED + WEATHER)
"""What is asked of a bank: with everything foreseen, or the set-points planned that came; and with the inputs that no
heater drives foreseen as well, or planned as they came."""

_LEVELS = tuple(np.arange(0.05, 1.0, 0.1).round(2).tolist())
"""Of intervals whose bounds are the quantiles in the middle of each twentieth."""
_DETAIL = Detail(FEWEST_DRAWS, exact=False)
_MAX_GAP = 12


class AnsweredRun(NamedTuple):
    """Which of ANSWERED is asked, of which zone."""

    question: str
    zone: FilterRun


def run_answered(run: AnsweredRun) -> Arrays:
    """The arrays of `Forecasts` at the leads of the zone, every one issued as those of the hours ahead, and `seconds`
    (). Nothing is forecast while set-points are planned and no law that keeps them is known."""
    began, (question, zone) = time.perf_counter(), run
    estimator, known, _ = built(zone)
    series, steps = zone.series, max(zone.leads)
    count, inputs = len(series.times), estimator.network.inputs
    setpoints = np.full(count, np.nan) if series.setpoints is None else series.setpoints
    planned = {SET_POINTS: setpoints} if question.startswith(SCHEDULED) else {}
    if question.endswith(WEATHER):
        weather = [place for place, name in enumerate(inputs) if estimator.network.channel_unit(name) != "W"]
        planned |= {inputs[place]: series.inputs[:, place] for place in weather}
    worker = ZoneWorker(estimator, WorkerSettings(zone.seed, (LEVEL,), _MAX_GAP, _MAX_GAP * zone.period), known)
    kept, due = no_forecasts(count, len(zone.leads)), set(issued(series, zone.period, steps).tolist())
    for row, when in enumerate(series.times.tolist()):
        sample = Sample.measured(when, series.outputs[row], series.inputs[row])
        worker.step(sample._replace(setpoint=float(setpoints[row])))
        if row in due:
            plan = {name: values[row + 1 : row + steps] for name, values in planned.items()}
            asked = FanQuestion(steps - 1, plan, _LEVELS, 0, _DETAIL)
            with suppress(NoLaw):
                _keep(kept, asked(worker, NO_WEATHER, lambda: False), series.outputs[:, 0], row, zone.leads)
    return kept._asdict() | {"seconds": np.array(time.perf_counter() - began)}


def _keep(kept: Forecasts, fan: Fan | None, y: Array, row: int, leads: Sequence[int]) -> None:
    """Note what a `fan` after the sample of `row` says at `leads`, against `y` (K,)."""
    if fan is None:
        return
    (output, *_), interval = fan.outputs, _LEVELS.index(LEVEL)
    quantiles = np.vstack([output.lower[::-1], output.upper])
    shares = (np.arange(len(quantiles)) + 0.5) / len(quantiles)
    for place, lead in enumerate(leads):
        target, step = row + lead, lead - 1
        kept.mean[target, place] = output.mean[step]
        kept.lower[target, place] = output.lower[interval, step]
        kept.upper[target, place] = output.upper[interval, step]
        # Twice the mean of the quantile scores.
        above = quantiles[:, step] - y[target]
        kept.crps[target, place] = 2.0 * np.mean(((above > 0.0) - shares) * above)
