"""Forecasts of zones under a plan: rooms that share walls are simulated together, then each zone is asked."""

import asyncio
import os
from collections.abc import Mapping, Sequence

from service.errors import Away, NoLaw, NoModel, ServiceError
from service.forecast.coupling import Member, coupled
from service.forecast.engine import FanQuestion, Neighbour, PartQuestion
from service.forecast.plan import Plan
from service.forecast.request import Detail, ForecastRequest, detail, levels_of, plannable, steps_of
from service.records.fan import Fan
from service.records.view import Answer, Question, ZoneView

_AT_ONCE = 2 * (os.cpu_count() or 1)
"""Zones of a request that are asked at once: enough for every processor to have one that is next."""


def neighbourhood(asked: Sequence[ZoneView], zones: Mapping[str, ZoneView]) -> list[ZoneView]:
    """Those of `zones` that are coupled with those `asked`, near or far, and not asked for themselves."""
    found, known, ahead = [], {view.id for view in asked}, list(asked)
    while ahead:
        view = ahead.pop()
        for other, _ in view.surroundings.neighbours.values():
            if other not in known and other in zones and zones[other].period == view.period:
                known.add(other)
                found.append(zones[other])
                ahead.append(zones[other])
    return found


async def forecasts(request: ForecastRequest, plan: Plan) -> list[Fan | ServiceError | None]:
    """The forecast of each zone of the request under `plan`, with the zones around simulated. None for one that has
    none now, or an error: not reached (Away), no scenarios (NoModel), no law for planned set-points (NoLaw)."""
    fine = detail([steps_of(request, view) + 1 for view in request.zones] * len(request.plans))
    questions = {view.id: _question(request, plan, view, fine) for view in (*request.zones, *request.around)}
    # Other clients' questions come in between: no request fills the threads' queue.
    turns = asyncio.Semaphore(_AT_ONCE)
    known, away = await _neighbours(request, questions, turns)

    async def answered(view: ZoneView) -> Fan | ServiceError | None:
        if view.id in away:
            return away[view.id]
        return await _asked(view, questions[view.id]._replace(neighbours=known.get(view.id, {})), turns)

    return list(await asyncio.gather(*(answered(view) for view in request.zones)))


def _question(request: ForecastRequest, plan: Plan, view: ZoneView, fine: Detail) -> FanQuestion:
    planned = {channel: values for channel, (_, values) in plan.of(view.id, plannable(view)).items()}
    return FanQuestion(steps_of(request, view), planned, tuple(levels_of(request, view)), request.scenarios, fine)


async def _asked(view: ZoneView, question: Question[Answer], turns: asyncio.Semaphore) -> Answer | ServiceError:
    async with turns:
        try:
            return await view.ask(question)
        except (Away, NoLaw, NoModel) as error:
            return error


async def _neighbours(
    request: ForecastRequest, questions: Mapping[str, FanQuestion], turns: asyncio.Semaphore
) -> tuple[Mapping[str, Mapping[str, Neighbour]], Mapping[str, ServiceError]]:
    """What the neighbours of each zone are forecast to do, by zone and input; and the zones that cannot be reached."""
    next_door = _next_door(request, questions)
    involved = {zone for own in next_door.values() for zone, _ in own.values()} | next_door.keys()
    views = [view for view in (*request.zones, *request.around) if view.id in involved]
    if not views:
        return {}, {}
    parts = await asyncio.gather(*(_asked(view, PartQuestion(questions[view.id]), turns) for view in views))
    members, away = [], {}
    for view, part in zip(views, parts, strict=True):
        if isinstance(part, ServiceError):
            away[view.id] = part
        elif part is not None:
            members.append(Member(view, part, next_door.get(view.id, {})))
    return await asyncio.to_thread(coupled, members), away


def _next_door(request: ForecastRequest, questions: Mapping[str, FanQuestion]) -> dict[str, dict[str, tuple[str, str]]]:
    """By zone, the inputs that are the output of another zone of the request and that no plan says."""
    found = {}
    for view in (*request.zones, *request.around):
        own = {
            channel: other
            for channel, other in view.surroundings.neighbours.items()
            if other[0] in questions and channel not in questions[view.id].planned
        }
        if own:
            found[view.id] = own
    return found
