"""The zones of a request under a plan: coupled, forecast in parallel, and made an answer."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from service.errors import Away, NoModel
from service.records.outlook import Outlook
from service.records.update import Update
from service.records.view import ZoneView
from service.web.access import Caller
from service.web.control.answers import missing_payload, zone_payload
from service.web.control.checks import levels_of, whole_steps
from service.web.control.models import PlanForecastPayload, SiteForecastRequest, SitePlan, ZoneForecastPayload
from service.web.control.planning import filled, inputs_of, planned_values
from service.web.control.together import Part, ToldRoom, coupled
from service.web.zones import no_forecast

_AT_ONCE = 2 * (os.cpu_count() or 1)
"""Zones of a request that are forecast at once: enough for every processor to have one that is next."""

_ATTEMPTS = 3
"""How often a zone is asked again that took a new sample in the middle of a request."""

Answer = TypeVar("Answer")


def neighbourhood(asked: Sequence[ZoneView], zones: Mapping[str, ZoneView], caller: Caller) -> list[ZoneView]:
    """The zones that are coupled with those `asked`, near or far, and not asked for themselves."""
    found, known, ahead = [], {view.id for view in asked}, list(asked)
    while ahead:
        view = ahead.pop()
        for other, _ in view.surroundings.neighbours.values():
            if other in known or other not in zones or not caller.sees(other):
                continue
            if zones[other].period == view.period:
                known.add(other)
                found.append(zones[other])
                ahead.append(zones[other])
    return found


async def under(
    plan: SitePlan, body: SiteForecastRequest, asked: Sequence[ZoneView], around: Sequence[ZoneView]
) -> PlanForecastPayload:
    """The zones `asked` under `plan`; those `around` are simulated with them. Where one cannot be reached, the others
    have their forecasts all the same."""
    views, away = (*asked, *around), dict[str, str]()

    async def reached(view: ZoneView, answer: Awaitable[Answer]) -> Answer | None:
        try:
            return await answer
        except Away as error:
            away[view.id] = str(error)
            return None

    foreseen = await asyncio.gather(*(reached(view, _foreseen(view, body.horizon)) for view in views))
    made = await asyncio.to_thread(lambda: [_part(plan, *one) for one in zip(views, foreseen, strict=True)])
    parts = {part.view.id: part for part in made if part is not None}
    next_door = {name: {zone for zone, _ in part.foreseen.values()} for name, part in parts.items()}
    involved = {name for name, others in next_door.items() if others}.union(*next_door.values())
    together = [part for name, part in parts.items() if name in involved]
    for part in together:
        await reached(part.view, _give_room(part))
    if together:
        await asyncio.to_thread(coupled, together)
    # Other clients' questions come in between: no request fills the threads' queue.
    turns = asyncio.Semaphore(_AT_ONCE)

    async def in_turn(view: ZoneView) -> ZoneForecastPayload:
        async with turns:
            if view.id not in away:
                found = await reached(view, _forecast(plan, body, view, parts.get(view.id)))
                if found is not None:
                    return found
            return missing_payload(view, away[view.id], body.horizon)

    return PlanForecastPayload(name=plan.name, zones=await asyncio.gather(*(in_turn(view) for view in asked)))


async def _foreseen(view: ZoneView, horizon: float) -> tuple[Update, Outlook] | None:
    return await view.outlook(whole_steps(horizon, view.period))


def _part(plan: SitePlan, view: ZoneView, foreseen: tuple[Update, Outlook] | None) -> Part | None:
    """The zone with its inputs under `plan`, otherwise as `foreseen`; None where it has no forecast."""
    if foreseen is None:
        return None
    update, outlook = foreseen
    planned = {}
    for channel, (_, value) in inputs_of(plan, view.id, view.network).items():
        values = planned_values(value, update.forecast.valid_time, view.period, len(outlook.rows))
        if not isinstance(values, str):
            planned[channel] = values
    return Part(view, update, filled(outlook, view.network, planned))


async def _give_room(part: Part) -> None:
    part.room = await part.view.room(part.update)
    if part.room is None:
        fan = await part.view.compact_fan(part.update, (), part.outlook.rows, 0)
        if fan is not None:
            part.room = ToldRoom(np.column_stack([output.mean for output in fan.outputs]))


async def _forecast(
    plan: SitePlan, body: SiteForecastRequest, view: ZoneView, part: Part | None
) -> ZoneForecastPayload:
    """The forecast of one zone; one that has taken a new sample meanwhile is asked again."""
    try:
        for _ in range(_ATTEMPTS):
            if part is None:
                return missing_payload(view, str(no_forecast(view)), body.horizon)
            levels = levels_of(body, view)
            fan = await view.compact_fan(part.update, levels, part.outlook.rows, body.scenarios)
            if fan is not None:
                limits = view.surroundings.limits
                return await asyncio.to_thread(zone_payload, part, fan, levels, limits, body.horizon)
            before, part = part, _part(plan, view, await _foreseen(view, body.horizon))
            if part is not None:
                # Its neighbours are still those that it was simulated with, one period later.
                part.outlook = _carried(before, part)
    except NoModel as error:
        return missing_payload(view, f"the estimator '{view.estimator}' has no scenarios: {error}", body.horizon)
    return missing_payload(view, f"zone '{view.id}' takes samples faster than it is forecast; ask again", body.horizon)


def _carried(before: Part, after: Part) -> Outlook:
    """The outlook of `after` with what the neighbours were to do in `before`."""
    rows, origins = after.outlook.rows.copy(), list(after.outlook.origins)
    late = round((after.start - before.start) / after.view.period)
    for column, origin in enumerate(before.outlook.origins):
        if origin.origin == "neighbour" and 0 <= late < len(rows):
            told = before.outlook.rows[late:, column]
            rows[: len(told), column], rows[len(told) :, column] = told, told[-1]
            origins[column] = origin
    return Outlook(rows, tuple(origins))
