"""What a zone answers to questions: about its heating, about the room, and its linear model."""

import math
from typing import Literal

from service.records.record import Matrices, Matrix, Moment, Number, Time, Vector, constant, record, shown


@record
class Range:
    """A mean and the interval that holds 95 % of the futures."""

    mean: Number
    lower: Number
    upper: Number


@record
class LearnedLaw:
    """What a heat input does under the set-point, as it was learned: the law of the thermostat."""

    channel: str
    side: str = shown("heating or cooling")
    law: str = shown("proportional or on-off")
    power: Range = shown("W, all that it gives")
    offset: Range = shown("K below the set-point (cooling: above) at which it gives half of it")
    band: Range = shown("K over which it goes from nothing to all; of an on-off law its hysteresis")
    explained: Number = shown("share of the variance of the heat that the law explains")
    days: int = shown("days that it was learned from")
    shortest_on: Number = shown("min, on-off: the shortest that it stayed on, but for one time in 20", default=math.nan)
    shortest_off: Number = shown("min, on-off: the same of staying off; null where not known", default=math.nan)


@record
class Preheat:
    """When to raise the set-point so that the zone is warm in time."""

    issue_time: Moment = shown("time of the newest forecast, from which all futures start")
    trust: str = shown("trust in forecasts so far ahead: learning, trusted or doubtful")
    target: Number = shown("degC")
    by: Moment = shown("when the zone shall be warm")
    tolerance: Number = shown("K below the target at which it counts as reached")
    probability: Number = shown("what was asked for, 0 to 1")
    start: Moment | None = shown("latest time to raise the set-point; null: not even now is early enough")
    minutes: Number = shown("from start to by, min; null without start")
    reached: Number = shown("probability of being warm in time with this start, or, without one, when starting now")
    temperature: Range = shown("at `by`, degC")
    energy: Range = shown("from issue_time to `by`, kWh")
    setpoint_before: Number = shown("set-point until the start, degC")


@record
class Hour:
    """The energy of one hour, or of the part of it that is asked for."""

    begin: Moment
    energy: Range = shown("kWh")


@record
class Demand:
    """The energy that a zone's thermostat will call for."""

    issue_time: Moment = shown("time of the newest forecast, from which all futures start")
    trust: str = shown("trust in forecasts so far ahead: learning, trusted or doubtful")
    horizon_s: Number
    planned: bool = shown("whether set-points were planned; otherwise they are foreseen, as several futures")
    total: Range = shown("kWh over the horizon")
    hours: list[Hour] = shown("whole hours of UTC; the first and the last may be a part of one")


@record
class ZoneTotal:
    """A zone's share of the site's demand."""

    zone: str
    total: Range | None = shown("kWh over the horizon; null where there is none, and `reason` says why")
    reason: str = ""


@record
class SiteDemand:
    """The energy that the thermostats of several zones will call for; weather apart, their errors are independent."""

    horizon_s: Number
    total: Range = shown("kWh over the horizon, of the zones that have a total")
    zones: list[ZoneTotal]


@record
class PlanOutcome:
    """What a plan of set-points comes to, or how much more that is than under the first plan, future by future."""

    name: str
    energy: Range = shown("kWh over the horizon")
    cost: Range | None = shown("in the currency of the price; null without a price")
    hours_below: Range = shown("h in which the zone is colder than the set-points of the first plan by more than 0.5 K")


@record
class Comparison:
    """Plans of set-points against the first of them."""

    issue_time: Moment = shown("time of the newest forecast, from which all futures start")
    trust: str = shown("trust in forecasts so far ahead: learning, trusted or doubtful")
    horizon_s: Number
    plans: list[PlanOutcome]
    differences: list[PlanOutcome] = shown("of every other plan; the interval is of the difference itself")


@record
class RoomAnswer:
    """One answer about a room: a sentence, and the number in it with its 95 % interval."""

    about: str = shown(
        "comfort, heat_loss, cooling, heating, warming_up, other_heat, energy, saving, window or last_day"
    )
    sentence: str
    unit: str
    value: Number = shown("null where it is not known", default=math.nan)
    lower: Number = shown("null where there is no interval to believe", default=math.nan)
    upper: Number = shown(default=math.nan)


@record
class ToDo:
    """Something to do about a room, and why."""

    what: str
    why: str
    urgency: Number = shown("from -1, at once, to 5: rooms are ranked by the first thing to do", default=5.0)


@record
class Room:
    """How a room did over some days, what it is like, and what to do: the first thing on its page and in its report."""

    days: Number = shown("days that were looked at, gaps left out")
    answers: tuple[RoomAnswer, ...]
    sun: tuple[Number, ...] = shown("heat of the sun in each hour of the local day, W: mean of the days")
    people: tuple[Number, ...] = shown("the same of people, appliances and whatever else nobody measures")
    to_do: tuple[ToDo, ...] = shown("at most three, the most important first")


@record
class QuantityPayload:
    """A state, input or output, in the order of the matrices."""

    name: str
    unit: str


@record
class MatricesPayload:
    """x' = A x + B u + w, w ~ N(0, Q); y = C x + v, v ~ N(0, R). An unmeasured gain is the last state."""

    A: Matrix = shown("(n_x, n_x); the last column is what the gain does, if there is one")
    B: Matrix = shown("(n_x, n_u)")
    C: Matrix = shown("(n_y, n_x)")
    Q: Matrix = shown("(n_x, n_x), K^2 and W^2 per step")
    R: Matrix = shown("(n_y, n_y), K^2")
    state: Vector = shown("(n_x,), degC and W, at valid_time")


@record
class DrawsPayload:
    """K models: the same matrices with one more axis in front; C is the same for all."""

    weights: Vector = shown("they add up to 1")
    A: Matrices
    B: Matrices
    Q: Matrices
    R: Matrices
    state: Matrix


@record
class GainForecastPayload:
    """The unmeasured gain at the beginning of each step of a day."""

    unit: Literal["W"] = constant("W")
    mean: Vector
    sd: Vector = shown("W; over the draws")


@record
class ModelAbout:
    """What the linear model of a zone is of."""

    sample_time: Time
    issue_time: Time
    valid_time: Time = shown("the time of the state")
    period_s: float
    step_s: float
    network: str
    estimator: str
    member: str = shown("the member of a bank whose model this is; empty for other estimators")
    share: float = shown("what that member weighs in the bank's forecast a few hours ahead; otherwise 1")
    fan_mean: str = shown("what gives the mean of the fan (of the member) when simulated: mean or draws")
    states: tuple[QuantityPayload, ...] = shown("temperatures, and then the unmeasured gain if there is one")
    inputs: tuple[QuantityPayload, ...]
    outputs: tuple[QuantityPayload, ...]


@record
class ModelPayload(ModelAbout):
    """The linear model of a zone, at the step that was asked for."""

    mean: MatricesPayload = shown("at the posterior mean of the log parameters")
    covariance: Matrix = shown("of the state, K^2 and W^2")
    draws: DrawsPayload
    known_heat: Matrix = shown(
        "what sun and habits add to each state over each step of a day, K, under inputs as foreseen "
        "without a plan: x' = A x + B u + this; empty where the zone knows neither"
    )
    gain: GainForecastPayload | None = shown("null for an estimator without a model of it")
