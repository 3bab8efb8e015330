"""Whether a request for many forecasts can be answered: bounds on its work, and mistakes in its plans."""

from __future__ import annotations

from collections.abc import Sequence

from service.records.view import ZoneView
from service.web.control.models import EVERY_ZONE, SiteForecastRequest, SitePlan
from service.web.control.planning import beyond, inputs_of, mistakes, planned_values
from service.web.plan import steps_in
from service.web.problems import invalid
from service.web.zones import published_levels

MOST_STEPS = 100_000
"""Steps of all zones, with those that they are coupled with, and plans of one request."""
MOST_VALUES = 500_000
"""Numbers in the answer: steps times intervals and scenarios."""
LARGE = 100_000
"""From so many numbers on an answer is made in turn with others."""
MOST_FANS = 2000
"""Zones times plans of one request."""
MOST_PLANNED = 500_000
"""Planned values of one request, those for every zone once for each."""
MOST_SENTENCES = 20
"""Mistakes that are named at once."""


def bound(body: SiteForecastRequest, asked: Sequence[ZoneView], around: Sequence[ZoneView]) -> int:
    """How many numbers the answer has. RequestRefused for more work than one request may ask; the zones `around` are
    simulated with those `asked`."""
    fans, planned = len(asked) * len(body.plans), sum(_size(plan, len(asked)) for plan in body.plans)
    if fans > MOST_FANS:
        raise invalid(
            [
                f"{len(asked)} zones with {len(body.plans)} plans are {fans} forecasts; at most {MOST_FANS} are made "
                "in one request, so ask for fewer zones or plans"
            ]
        )
    if planned > MOST_PLANNED:
        raise invalid([f"the plans have {planned} values; at most {MOST_PLANNED} are read in one request"])
    steps = sum(whole_steps(body.horizon, view.period) for view in around) * len(body.plans)
    values = 0
    for view in asked:
        levels = levels_of(body, view)
        own = (steps_in(body.horizon, view.period, len(levels)) + 1) * len(body.plans)
        steps += own
        values += own * (3 + 2 * len(levels) + body.scenarios) * len(view.network.measured)
    if steps > MOST_STEPS:
        coupled = f" and {len(around)} that are coupled with them" if around else ""
        raise invalid(
            [
                f"{len(asked)} zones{coupled} with {len(body.plans)} plans are {steps} steps; at most {MOST_STEPS} are "
                "forecast in one request, so ask for fewer zones, plans or a shorter horizon"
            ]
        )
    if values > MOST_VALUES:
        raise invalid(
            [
                f"the answer would have {values} numbers; at most {MOST_VALUES} are given in one request, so ask for "
                "fewer scenarios, levels, zones or plans"
            ]
        )
    return values


def _size(plan: SitePlan, zones: int) -> int:
    """How many values `plan` has, those for every zone once for each of `zones`."""
    return sum(
        (zones if zone == EVERY_ZONE else 1) * (len(value) if isinstance(value, list) else 1)
        for zone, inputs in plan.inputs.items()
        for value in inputs.values()
    )


def understood(body: SiteForecastRequest, zones: Sequence[ZoneView]) -> None:
    """RequestRefused with one sentence per mistake in the plans for `zones`, those asked for and their neighbours."""
    found: list[str] = []
    for index, plan in enumerate(body.plans):
        place, seen = f"plans[{index}].inputs", set[str]()
        for zone in plan.inputs:
            if zone not in (EVERY_ZONE, *(view.id for view in zones)):
                found.append(f"field '{place}.{zone}' is not a zone of this request")
        for view in zones:
            found += mistakes(plan, view.id, view.network, place, seen)
            found += _wrong_values(plan, view, body.horizon, place)
        nowhere = plan.inputs.get(EVERY_ZONE, {}).keys() - seen
        found += [f"field '{place}.*.{channel}' is an input of none of the zones" for channel in sorted(nowhere)]
    if found:
        raise invalid(found[:MOST_SENTENCES])


def _wrong_values(plan: SitePlan, view: ZoneView, horizon: float, place: str) -> list[str]:
    update, found = view.latest(), []
    start = 0 if update is None else update.forecast.valid_time
    steps = whole_steps(horizon, view.period)
    for channel, (owner, value) in inputs_of(plan, view.id, view.network).items():
        values = planned_values(value, start, view.period, steps)
        why = values if isinstance(values, str) else beyond(values, channel, view.network, view.surroundings.limits)
        if why is not None:
            found.append(f"field '{place}.{owner}.{channel}' {why}")
    return found


def whole_steps(horizon: float, period: float) -> int:
    """The periods (s) of a `horizon` (s); of a neighbour with a period of its own, the nearest number."""
    return max(1, round(horizon / period))


def levels_of(body: SiteForecastRequest, view: ZoneView) -> Sequence[float]:
    """The levels of the intervals of a zone: those asked for, or those that it publishes."""
    if body.levels:
        return body.levels
    update = view.latest()
    return [] if update is None else published_levels(update)
