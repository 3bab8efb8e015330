"""Questions about a zone's heating, each answered from one state by the futures that run the thermostat
(`estimator.thermostat.live`): when to start, what it will take, what another plan changes."""

import re
from collections.abc import Callable, Sequence
from datetime import datetime, time, timedelta, tzinfo
from typing import NamedTuple, Self

import numpy as np

from adapters.fields.durations import spoken_duration
from adapters.fields.times import ZoneMissing, parse_time, utc, written_time
from estimator.arrays import Array, Indices
from estimator.foresight import FUTURES
from estimator.thermostat import answers, memory
from estimator.thermostat.answers import Amounts
from estimator.thermostat.live import Fan
from estimator.types import Mixtures
from estimator.verification.summaries import summary
from service.errors import NoLaw, PlanError, ServiceError
from service.forecast.answers import Comparison, Demand, Hour, PlanOutcome, Preheat, Range
from service.forecast.engine import GIVEN_UP
from service.forecast.foresight import foresee
from service.forecast.plan import Grid, Values, column
from service.forecast.planned import PlannedZone
from service.forecast.request import MAX_STEPS
from service.forecast.shares import Shares
from service.records.outlook import SET_POINTS, Weather
from service.records.trust import LEARNING, UNTRUSTED, Trust
from service.zone.worker import Standing, ZoneWorker

COLD = 0.5
"""K below a set-point from which on a room counts as too cold."""
SWING = 2 * 3600.0
"""s in which a room is warm once under a thermostat that lets it swing around its set-point."""
_LEVELS = np.array([0.025, 0.975])
_HOUR = 3600.0
_CLOCK = re.compile(r"[0-9]{2}:[0-9]{2}(:[0-9]{2})?")
"""ISO 8601 takes a year, 2026, for 20:26 as well."""
_PAIRED = 4000
"""Sums of zones that are drawn for the interval of their total."""


def refusal(trust: Trust, lead: float) -> str | None:
    """Why nobody should rely on forecasts `lead` s ahead; None where they may."""
    horizon = trust.at(lead)
    if horizon is None or horizon.level != UNTRUSTED:
        return None
    return f"is not trusted {spoken_duration(horizon.lead)} ahead: {horizon.reason}"


def moment(text: str, start: float, local: tzinfo) -> float:
    """UTC s of `text`, which is RFC 3339 or the next such time of day after UTC s `start` in the time zone `local`;
    PlanError for another text."""
    try:
        clock = time.fromisoformat(text) if _CLOCK.fullmatch(text) else None
    except ValueError:
        clock = None
    if clock is not None:
        today = datetime.combine(utc(start).astimezone(local).date(), clock, local)
        # Where the clocks are put back, a time comes twice in a day.
        return next(
            when
            for one in (today, today.replace(fold=1), today + timedelta(days=1))
            if (when := one.timestamp()) > start
        )
    try:
        return parse_time(text).timestamp()
    except ZoneMissing:
        raise PlanError("has no time zone; end it with Z for UTC or an offset such as +02:00") from None
    except ValueError:
        raise PlanError("is no time; write it as 06:30, or as 2026-01-31T06:30:00+01:00") from None


def check_until(by: float, start: float, period: float) -> None:
    """PlanError if UTC s `by` is not ahead of `start`, or further than is forecast in steps of `period` s."""
    if by <= start:
        raise PlanError(f"is {written_time(by)}, which is over; give a time after {written_time(start)}")
    if by - start > MAX_STEPS * period:
        raise PlanError(f"lies more than {spoken_duration(MAX_STEPS * period)} ahead, which is as far as is forecast")


class PreheatQuestion(NamedTuple):
    """Asks when to raise the set-point to `target` [degC], for the room to be no more than `tolerance` [K] below it
    `by` UTC s with a probability. Until the start it falls as it is likely to, and nobody raises it.

    Under a thermostat a room swings around its set-point, below it by more than `tolerance` as well: warm it is when
    it has been so in the last SWING, of which an earlier start takes nothing away.
    """

    target: float
    by: float
    probability: float
    tolerance: float

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Preheat | None:
        """The answer; None where there is no forecast now. NoLaw for a zone whose heat obeys no set-point."""
        standing = worker.unstalled
        if standing is None:
            return None
        start, period = float(standing.update.forecast.valid_time), worker.period
        steps = max(1, int(np.ceil((self.by - start) / period)))
        futures = _Futures(worker, standing, weather, steps, given_up)
        before, (swings, stride) = futures.falling, futures.swings(SWING)
        fans: dict[int, Fan] = {}

        def reached(step: int) -> float:
            setpoints = before.copy()
            setpoints[step:] = np.maximum(self.target, before[step:])
            fans[step] = futures.under(setpoints)
            return warm(step)

        def warm(step: int) -> float:
            count = min(-(-(steps - step) // stride), swings.shape[1])
            lately = fans[step].outputs.during(slice(steps - (count - 1) * stride, steps + 1, stride))
            return answers.probability_reached(lately, self.target - self.tolerance, swings[:, -count:])

        found = answers.latest(reached, steps - 1, self.probability)
        fan = fans[0 if found is None else found]
        last = fan.outputs.at(steps)
        lower, upper = summary(Mixtures.of_one(last), _LEVELS, exact=True).quantiles[0, 0].tolist()
        begin = None if found is None else start + found * period
        return Preheat(
            issue_time=standing.update.forecast.issue_time,
            trust=_trust(worker, futures.grid),
            target=self.target,
            by=self.by,
            tolerance=self.tolerance,
            probability=self.probability,
            start=begin,
            minutes=float("nan") if begin is None else (self.by - begin) / 60.0,
            reached=warm(0 if found is None else found),
            temperature=Range(float(last.mean()[0]), lower, upper),
            energy=_range(answers.energy(fan.heat, period).stretched(fan.energy_scales[-1:]), 0.0),
            setpoint_before=float(before[max((found or 0) - 1, 0)]),
        )


class Called(NamedTuple):
    """What a zone's thermostat will call for: the answer, and the sum of each future behind it."""

    demand: Demand
    total: Amounts


class DemandQuestion(NamedTuple):
    """Asks for the energy of `steps` steps, under planned set-points [degC] or (None) those that are foreseen."""

    steps: int
    setpoints: Values | None

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Called | None:
        """As `PreheatQuestion`; PlanError for set-points that do not fit the steps."""
        standing = worker.unstalled
        if standing is None:
            return None
        start, period = float(standing.update.forecast.valid_time), worker.period
        futures = _Futures(worker, standing, weather, self.steps, given_up)
        fan = futures.under(None if self.setpoints is None else futures.planned(self.setpoints))
        # Of steps longer than an hour, some hours begin none.
        hours, spans = np.unique((start + period * np.arange(self.steps)) // _HOUR, return_inverse=True)
        total = answers.energy(fan.heat, period).stretched(fan.energy_scales[-1:])
        scales = fan.energy_scales[np.flatnonzero(np.diff(spans, append=len(hours)))]
        amounts = answers.energy(fan.heat, period, spans).stretched(scales)
        means, quantiles = amounts.mean(), np.maximum(amounts.quantiles(_LEVELS), 0.0)
        demand = Demand(
            issue_time=standing.update.forecast.issue_time,
            trust=_trust(worker, futures.grid),
            horizon_s=float(self.steps * period),
            planned=self.setpoints is not None,
            total=_range(total, 0.0),
            hours=[
                Hour(max(start, hour * _HOUR), Range(mean, *bounds))
                for hour, mean, bounds in zip(hours.tolist(), means.tolist(), quantiles.tolist(), strict=True)
            ],
        )
        return Called(demand, total)


class Course(NamedTuple):
    """A plan of set-points [degC] that is compared with others."""

    name: str
    setpoints: Values


class CompareQuestion(NamedTuple):
    """Asks what plans of set-points over `steps` steps come to, and differ from the first; `price` is per kWh."""

    steps: int
    courses: Sequence[Course]
    price: Values | None = None

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Comparison | None:
        """As `DemandQuestion`."""
        standing = worker.unstalled
        if standing is None:
            return None
        futures = _Futures(worker, standing, weather, self.steps, given_up)
        planned = [futures.planned(course.setpoints) for course in self.courses]
        price = None if self.price is None else column(self.price, futures.grid)
        fans = [futures.under(setpoints) for setpoints in planned]
        found = [_Outcome.of(fan, planned[0], worker.period, price) for fan in fans]
        alone = [one.stretched(fan.energy_scales[-1:]) for one, fan in zip(found, fans, strict=True)]
        return Comparison(
            issue_time=standing.update.forecast.issue_time,
            trust=_trust(worker, futures.grid),
            horizon_s=float(self.steps * worker.period),
            plans=[PlanOutcome(course.name, *one.ranges(0.0)) for course, one in zip(self.courses, alone, strict=True)],
            differences=[
                PlanOutcome(course.name, *one.less(found[0]).ranges())
                for course, one in zip(self.courses[1:], found[1:], strict=True)
            ],
        )


class _Outcome(NamedTuple):
    """What one plan comes to, future by future."""

    energy: Amounts
    cost: Amounts | None
    hours_below: Amounts

    @classmethod
    def of(cls, fan: Fan, setpoints: Array, period: float, price: Array | None) -> Self:
        return cls(
            answers.energy(fan.heat, period),
            None if price is None else answers.energy(fan.heat, period, price=price),
            # The means of the mixtures after the first are the temperatures of the futures.
            answers.below(fan.outputs.means[1:, 0].T, setpoints, fan.outputs.weights[1:], period, COLD),
        )

    def stretched(self, scale: Array) -> Self:
        """With energies and costs `scale` times as far from their means."""
        cost = None if self.cost is None else self.cost.stretched(scale)
        return self._replace(energy=self.energy.stretched(scale), cost=cost)

    def less(self, other: Self) -> "_Outcome":
        """The difference to `other`, of the same futures under another plan."""
        energy, cost = answers.difference(self.energy, other.energy), None
        if self.cost is not None and other.cost is not None:
            cost = answers.difference(self.cost, other.cost)
        whole = _Outcome(energy, cost, answers.difference(self.hours_below, other.hours_below))
        return whole.stretched(energy.unsure())

    def ranges(self, least: float = -np.inf) -> tuple[Range, Range | None, Range]:
        """Energy, of `least` kWh, cost, which may be negative as prices are, and hours."""
        cost = None if self.cost is None else _range(self.cost)
        return _range(self.energy, least), cost, _range(self.hours_below)


class _Futures:
    """The futures of one zone from one state on."""

    def __init__(
        self, worker: ZoneWorker, standing: Standing, weather: Weather, steps: int, given_up: Callable[[], bool]
    ) -> None:
        thermostat, self._zone = standing.carried.thermostat, PlannedZone.of(worker, standing, {}, steps)
        if not worker.loop.live.obeyed(thermostat):
            raise NoLaw(self._zone.why_no_law)
        self._memory, self.setpoint = thermostat.memory, float(thermostat.setpoint)
        """The set-point now [degC]."""
        self.grid = self._zone.grid
        self._shares, self._columns = Shares.of(worker), thermostat.laws.column.astype(np.int64)
        outlook = foresee(worker, standing, steps, weather)
        self._ahead, self._given_up = self._zone.ahead(outlook), given_up

    @property
    def falling(self) -> Array:
        """(h,): the set-points [degC] while nobody raises any: the present one at most, lower as is likely."""
        return np.asarray(np.fmin.accumulate(np.fmin(self._zone.likely, self.setpoint)))

    def swings(self, span: float) -> tuple[Array, int]:
        """As `estimator.thermostat.memory.swings`, and the steps from one of its times to the next."""
        found = memory.swings(self._memory, self.grid.start, span)
        return found, max(1, round(span / found.shape[1] / self.grid.period))

    def planned(self, setpoints: Values) -> Array:
        """(h,): set-points [degC]; the likeliest where none is planned yet."""
        found = column(setpoints, self.grid)
        return np.where(np.isnan(found), self._zone.likely, found)

    def under(self, setpoints: Array | None) -> Fan:
        """The futures under `setpoints` (h,) [degC], or (None) those that are foreseen."""
        if self._given_up():
            raise ServiceError(GIVEN_UP)
        fan = self._zone._replace(planned={} if setpoints is None else {SET_POINTS: setpoints}).with_law(self._ahead)
        assert fan is not None, "a law is known"
        own = self._shares.sampled(self._columns, len(fan.heat.values))
        return fan._replace(heat=fan.heat._replace(values=fan.heat.values * own[:, None]))


def _trust(worker: ZoneWorker, grid: Grid) -> str:
    """How far forecasts over the whole grid are trusted."""
    horizon = worker.trust.at(grid.steps * grid.period)
    return LEARNING if horizon is None else horizon.level


def _range(amounts: Amounts, least: float = -np.inf) -> Range:
    lower, upper = np.maximum(amounts.quantiles(_LEVELS)[0], least).tolist()
    return Range(float(amounts.mean()[0]), lower, upper)


def together(totals: Sequence[Amounts]) -> Range:
    """The sum of what zones call for, which have one weather; their other errors are taken to be independent."""
    if not totals:
        return Range(0.0, 0.0, 0.0)
    draws = np.random.default_rng(0)
    weather = draws.integers(0, FUTURES, _PAIRED)
    sums = sum(_in_weather(one, weather, draws) for one in totals)
    lower, upper = np.quantile(sums, _LEVELS).tolist()
    return Range(float(sum(one.mean()[0] for one in totals)), lower, upper)


def _in_weather(total: Amounts, weather: Indices, draws: np.random.Generator) -> Array:
    """(P,): draws of a zone's total in each `weather` (P,), and in any where it knows no such future."""
    values, weights = np.maximum(total.values[:, 0], 0.0), total.weights[:, 0]
    found = draws.choice(values, len(weather), p=weights)
    asking = total.weather >= 0
    for number in np.unique(total.weather[asking]).tolist():
        there, asked = total.weather == number, np.flatnonzero(weather == number)
        share = np.where(there, weights * weights[asking].sum() / weights[there].sum(), np.where(asking, 0.0, weights))
        found[asked] = draws.choice(values, len(asked), p=share / share.sum())
    return found
