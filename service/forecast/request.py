"""A request for forecasts: what is asked, how much of it one request may ask, and mistakes in its plans."""

from collections.abc import Sequence
from typing import NamedTuple

from adapters.fields.durations import format_duration
from service.errors import PlanError, RequestError
from service.forecast.plan import EVERY_ZONE, Grid, Plan, Stepped, Timed, Values, check
from service.records.outlook import SET_POINTS
from service.records.update import Update
from service.records.view import ZoneView

MAX_STEPS = 2016
"""Steps of one forecast: a week of 5 min steps."""
MAX_INTERVALS = 4032
"""Intervals of one forecast: steps times levels."""
MOST_STEPS = 100_000
"""Steps of all zones, with those that they are coupled with, and plans of one request."""
MOST_VALUES = 500_000
"""Numbers in the answer: steps times intervals and scenarios."""
MOST_FANS = 2000
"""Zones times plans of one request."""
MOST_PLANNED = 500_000
"""Planned values of one request, those for every zone once for each."""
MOST_DRAW_STEPS = 30_000_000
"""Draws times steps of all forecasts of one request, as long as each has FEWEST_DRAWS: they are what takes time."""
MOST_AT_ONCE = 3_000_000
"""Draws times steps of one forecast: they are what takes memory."""
FEWEST_DRAWS = 1000
"""Draws that a forecast may always have."""
_ROUNDING = 1e-6


class Detail(NamedTuple):
    """How finely the distributions of a forecast are followed."""

    draws: int
    """Draws from the estimator at most."""
    exact: bool
    """Whether quantiles are those of all components, or of some that stand for them."""


class ForecastRequest(NamedTuple):
    """Forecasts of `zones` over `horizon` s beyond their published ones, under each of `plans`."""

    zones: Sequence[ZoneView]
    horizon: float
    levels: Sequence[float] = ()
    """Of the intervals; without any, those that each zone publishes."""
    plans: Sequence[Plan] = (Plan(),)
    scenarios: int = 0
    """Sampled futures of each zone under each plan."""
    around: Sequence[ZoneView] = ()
    """Zones that are simulated with them, as their neighbours."""


def detail(steps: Sequence[int]) -> Detail:
    """As fine as there is time and room for in a request of forecasts with so many `steps` each, the published one
    included: the same for each of them, whoever asks."""
    whole = sum(steps)
    draws = min(MOST_DRAW_STEPS // max(1, whole), MOST_AT_ONCE // max([1, *steps]))
    return Detail(max(FEWEST_DRAWS, draws), exact=whole <= MAX_STEPS + 1)


def steps_of(request: ForecastRequest, view: ZoneView) -> int:
    """The periods of the zone in the horizon; of a neighbour with a period of its own, the nearest number."""
    return round(request.horizon / view.period)


def levels_of(request: ForecastRequest, view: ZoneView) -> Sequence[float]:
    """The levels of the intervals of a zone: those asked for, or those that it publishes."""
    update = view.now().update
    return request.levels if request.levels or update is None else published_levels(update)


def plannable(view: ZoneView) -> tuple[str, ...]:
    """What may be planned of a zone: its inputs, and set-points where it has one."""
    inputs = view.network.inputs
    return (*inputs, SET_POINTS) if SET_POINTS in view.surroundings.limits and SET_POINTS not in inputs else inputs


def published_levels(update: Update) -> list[float]:
    """The levels of the intervals of the published forecast."""
    return [interval.level for interval in update.forecast.outputs[0].intervals]


def bound(request: ForecastRequest) -> int:
    """How many numbers the answer has. RequestError for a horizon that does not fit, or more work than one request may
    ask."""
    zones, plans = request.zones, len(request.plans)
    fans, planned = len(zones) * plans, sum(_size(plan, len(zones)) for plan in request.plans)
    if fans > MOST_FANS:
        raise _too_much(
            f"{len(zones)} zones with {plans} plans are {fans} forecasts; at most {MOST_FANS} are made in one request, "
            "so ask for fewer zones or plans"
        )
    if planned > MOST_PLANNED:
        raise _too_much(f"the plans have {planned} values; at most {MOST_PLANNED} are read in one request")
    steps, values = sum(steps_of(request, view) for view in request.around) * plans, 0
    for view in zones:
        levels = len(levels_of(request, view))
        own = whole_steps(request.horizon, view.period)
        if own > MAX_STEPS:
            raise _too_much(
                f"horizon {format_duration(request.horizon)} has {own} steps of {format_duration(view.period)}; "
                f"at most {MAX_STEPS} are forecast at once, that is {format_duration(MAX_STEPS * view.period)}"
            )
        if own * levels > MAX_INTERVALS:
            raise _too_much(
                f"{own} steps with {levels} levels each are too many; at most {MAX_INTERVALS} intervals are given at "
                "once"
            )
        own = (own + 1) * plans
        steps += own
        values += own * (3 + 2 * levels + request.scenarios) * len(view.network.measured)
    if steps > MOST_STEPS:
        coupled = f" and {len(request.around)} that are coupled with them" if request.around else ""
        raise _too_much(
            f"{len(zones)} zones{coupled} with {plans} plans are {steps} steps; at most {MOST_STEPS} are forecast in "
            "one request, so ask for fewer zones, plans or a shorter horizon"
        )
    if values > MOST_VALUES:
        raise _too_much(
            f"the answer would have {values} numbers; at most {MOST_VALUES} are given in one request, so ask for fewer "
            "scenarios, levels, zones or plans"
        )
    return values


class Mistake(NamedTuple):
    """What is wrong in a plan: its number, the zone and input it stands under (no input: the zone itself), a
    sentence."""

    plan: int
    zone: str
    channel: str | None
    sentence: str


def mistakes(request: ForecastRequest) -> list[Mistake]:
    """What is wrong in the plans for the zones of the request and those around."""
    found, views = [], (*request.zones, *request.around)
    for number, plan in enumerate(request.plans):
        known = {EVERY_ZONE, *(view.id for view in views)}
        unknown = [zone for zone in plan.inputs if zone not in known]
        found += [Mistake(number, zone, None, "is not a zone of this request") for zone in unknown]
        nowhere = set(plan.inputs.get(EVERY_ZONE, ()))
        for view in views:
            network, update = view.network, view.now().update
            inputs = plannable(view)
            nowhere -= set(inputs)
            start = 0 if update is None else update.forecast.valid_time
            grid = Grid(start, view.period, steps_of(request, view))
            used = plan.of(view.id, inputs)
            named = ((owner, channel) for owner in (EVERY_ZONE, view.id) for channel in plan.inputs.get(owner, ()))
            for owner, channel in named:
                if channel not in inputs and owner != EVERY_ZONE:
                    sentence = f"is not an input of this zone; its inputs are {', '.join(inputs)}"
                    found.append(Mistake(number, owner, channel, sentence + _remedy(channel)))
                elif channel in used and used[channel][0] == owner:
                    try:
                        check(used[channel][1], channel, network, view.surroundings.limits, grid)
                    except PlanError as error:
                        found.append(Mistake(number, owner, channel, str(error)))
        sentence = "is an input of none of the zones"
        found += [Mistake(number, EVERY_ZONE, each, sentence + _remedy(each)) for each in sorted(nowhere)]
    return found


def _remedy(channel: str) -> str:
    return f"; to plan {SET_POINTS}, give the zone a [zones.setpoint]" if channel == SET_POINTS else ""


def whole_steps(span: float, period: float, what: str = "horizon") -> int:
    """The periods [s] of a `span` [s]; RequestError, which calls it `what`, if there are none, or no whole number."""
    steps = round(span / period)
    if steps < 1 or abs(steps * period - span) > _ROUNDING:
        raise _too_much(
            f"{what} {format_duration(span)} is not a whole number of the zone's periods of "
            f"{format_duration(period)}; {format_duration(max(1, steps) * period)} would be"
        )
    return steps


def _too_much(sentence: str) -> RequestError:
    return RequestError([sentence])


def _size(plan: Plan, zones: int) -> int:
    """How many values `plan` has, those for every zone once for each of `zones`."""
    return sum(
        (zones if zone == EVERY_ZONE else 1) * _length(values)
        for zone, inputs in plan.inputs.items()
        for values in inputs.values()
    )


def _length(values: Values) -> int:
    if isinstance(values, int | float | Stepped):
        return 1
    return len(values.values if isinstance(values, Timed) else values)
