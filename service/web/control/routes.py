"""GET /zones/{zone}/model and /trust, and POST /forecasts."""

import asyncio
from collections.abc import Sequence
from contextlib import nullcontext
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Header, Query, Response

from adapters.fields.durations import DAY, format_duration
from service.errors import NoModel, ServiceError
from service.forecast.answers import ModelPayload
from service.forecast.learned import ModelQuestion
from service.forecast.plan import Plan
from service.forecast.request import ForecastRequest, Mistake, bound, mistakes, whole_steps
from service.forecast.site import forecasts as under
from service.forecast.site import neighbourhood
from service.records.fan import Fan
from service.records.record import document, to_json, with_items
from service.records.trust import Trust
from service.web.access import Asking, find_zone
from service.web.answering import asked, json_answer, no_forecast, route
from service.web.control.answers import model_npz, zone_forecast
from service.web.control.models import MAX_DRAWS, PlanForecastPayload, SiteForecastPayload, SiteForecastRequest
from service.web.limits import LARGE
from service.web.models import Horizon
from service.web.problems import invalid
from service.web.server.refusal import RequestRefused
from service.web.site import Asked, Here

NPZ = "application/x-npz"
MANY_NUMBERS = 100_000
"""From so many numbers on an answer is made in turn with others."""

router = APIRouter(tags=["control"])


@route(
    router,
    "GET /zones/{zone}/model",
    ModelPayload,
    responses={200: {"content": {NPZ: {"schema": {"type": "string"}}}}},
)
async def model(
    site: Here,
    view: Asked,
    step: Annotated[Horizon | None, Query(description="step of the matrices; default: the zone's period")] = None,
    draws: Annotated[int, Query(ge=1, le=MAX_DRAWS, description="how many draws at most")] = 100,
    accept: Annotated[str, Header()] = "application/json",
) -> Response:
    """State-space matrices: posterior mean and draws, state, covariance; JSON, or npz by Accept"""
    if step is not None and step > DAY:
        raise invalid([f"step {format_duration(step)} is longer than a day"])
    periods = 1 if step is None else whole_steps(step, view.period, "step")
    try:
        found = await asked(view, ModelQuestion(periods, draws, view.estimator))
    except NoModel as error:
        sentence = f"the estimator '{view.estimator}' of zone '{view.id}' has no model: {error}"
        raise RequestRefused(HTTPStatus.NOT_FOUND, [sentence]) from None
    # On a thread: a large one would hold the event loop.
    write, kind = (model_npz, NPZ) if NPZ in accept else (document, "application/json")
    return Response(await asyncio.to_thread(write, found, site.id, view.id), media_type=kind)


@route(router, "GET /zones/{zone}/trust", Trust)
async def trust(site: Here, view: Asked) -> Trust:
    """How far a controller may rely on the zone's forecasts, horizon by horizon"""
    found = view.now().trust
    if not found.horizons:
        raise no_forecast(view)
    return found


@route(router, "POST /forecasts", SiteForecastPayload, also=(400,))
async def forecasts(site: Here, caller: Asking, body: SiteForecastRequest) -> Response:
    """Forecasts of several zones under several plans, neighbours simulated together"""
    seen = {zone: view for zone, view in site.zones.items() if caller.sees(zone)}
    wanted = [find_zone(site.zones, zone, caller) for zone in dict.fromkeys(body.zones) or seen]
    plans = [Plan(one.name, one.inputs) for one in body.plans]
    around = neighbourhood(wanted, seen)
    request = ForecastRequest(wanted, body.horizon, body.levels, plans, body.scenarios, around)
    numbers = bound(request)
    if found := await asyncio.to_thread(mistakes, request):
        raise invalid([_told(one) for one in found])
    async with site.limiter.turn(LARGE) if numbers > MANY_NUMBERS else nullcontext():
        # A plan that is written takes half as much memory as one that is not.
        written = [
            await asyncio.to_thread(_written, request, plan, await under(request, plan)) for plan in request.plans
        ]
        about = document(SiteForecastPayload(body.horizon, ()), site.id)
        content = await asyncio.to_thread(with_items, about, written)
    return json_answer(content)


def _told(one: Mistake) -> str:
    place = f"plans[{one.plan}].inputs.{one.zone}" + ("" if one.channel is None else f".{one.channel}")
    return f"field '{place}' {one.sentence}"


def _written(request: ForecastRequest, plan: Plan, found: Sequence[Fan | ServiceError | None]) -> bytes:
    """All zones under `plan`, as JSON."""
    zones = (zone_forecast(view, fan, request.horizon) for view, fan in zip(request.zones, found, strict=True))
    return to_json(PlanForecastPayload(plan.name, tuple(zones)))
