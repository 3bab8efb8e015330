"""GET /zones/{zone}/model and /trust, and POST /forecasts."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import nullcontext
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Header, Query, Response

from service.errors import NoModel
from service.fields.durations import DAY, format_duration
from service.publish.payloads import Payload, TrustPayload, to_json, to_json_with
from service.publish.rendering import trust_payload
from service.records.view import ZoneView
from service.web.access import Asking, Caller, find_zone
from service.web.control.answers import model_npz, model_payload
from service.web.control.checks import LARGE, bound, understood
from service.web.control.models import ModelPayload, ModelQuery, SiteForecastPayload, SiteForecastRequest
from service.web.control.site import neighbourhood, under
from service.web.limits import LargeAnswers
from service.web.problems import documented, invalid
from service.web.server.refusal import RequestRefused
from service.web.zones import no_forecast

NPZ = "application/x-npz"


def control_routes(site: str, zones: Mapping[str, ZoneView]) -> APIRouter:
    """Routes over `zones`, whichever there are when a request comes."""
    router = APIRouter(tags=["control"])
    large = LargeAnswers()

    @router.get(
        "/zones/{zone}/model",
        response_model=ModelPayload,
        responses=documented(404, 422, 500, 503) | {200: {"content": {NPZ: {"schema": {"type": "string"}}}}},
        summary="State-space matrices: posterior mean and draws, state, covariance; JSON, or npz by Accept",
    )
    async def model(
        zone: str,
        caller: Asking,
        query: Annotated[ModelQuery, Query()],
        accept: Annotated[str, Header()] = "application/json",
    ) -> Response:
        view = find_zone(zones, zone, caller)
        periods = _periods(query.step, view.period)
        try:
            found = await view.model(periods, query.draws)
        except NoModel as error:
            sentence = f"the estimator '{view.estimator}' of zone '{zone}' has no model: {error}"
            raise RequestRefused(HTTPStatus.NOT_FOUND, [sentence]) from None
        if found is None:
            raise no_forecast(view)
        payload = await asyncio.to_thread(model_payload, site, view, found)
        if NPZ in accept:
            return Response(await asyncio.to_thread(model_npz, payload, found), media_type=NPZ)
        return await _json(payload)

    @router.get(
        "/zones/{zone}/trust",
        response_model=TrustPayload,
        responses=documented(404, 422, 500, 503),
        summary="How far a controller may rely on the zone's forecasts, horizon by horizon",
    )
    async def trust(zone: str, caller: Asking) -> Response:
        view = find_zone(zones, zone, caller)
        found = view.trust()
        if not found.horizons:
            raise no_forecast(view)
        return await _json(trust_payload(site, zone, found))

    @router.post(
        "/forecasts",
        response_model=SiteForecastPayload,
        responses=documented(400, 404, 422, 500, 503),
        summary="Forecasts of several zones under several plans, neighbours simulated together",
    )
    async def forecasts(caller: Asking, body: SiteForecastRequest) -> Response:
        asked = [find_zone(zones, zone, caller) for zone in _asked(body, zones, caller)]
        around = neighbourhood(asked, zones, caller)
        numbers = bound(body, asked, around)
        await asyncio.to_thread(understood, body, [*asked, *around])
        async with large.turn() if numbers > LARGE else nullcontext():
            # A plan that is written takes half as much memory as one that is not.
            plans = [await asyncio.to_thread(to_json, await under(plan, body, asked, around)) for plan in body.plans]
            envelope = SiteForecastPayload(site=site, horizon_s=body.horizon, plans=[])
            content = await asyncio.to_thread(to_json_with, envelope, plans)
        return Response(content, media_type="application/json")

    return router


async def _json(payload: Payload) -> Response:
    """`payload` rendered on a thread: a large one would hold the event loop."""
    return Response(await asyncio.to_thread(to_json, payload), media_type="application/json")


def _periods(step: float | None, period: float) -> int:
    """How many periods (s) a `step` (s) has; RequestRefused if it is no whole number, or more than a day."""
    if step is None:
        return 1
    periods = round(step / period)
    if periods < 1 or abs(periods * period - step) > 1e-6:
        near = format_duration(max(1, periods) * period)
        raise invalid(
            [
                f"step {format_duration(step)} is not a whole number of the zone's periods of "
                f"{format_duration(period)}; {near} would be"
            ]
        )
    if step > DAY:
        raise invalid([f"step {format_duration(step)} is longer than a day"])
    return periods


def _asked(body: SiteForecastRequest, zones: Mapping[str, ZoneView], caller: Caller) -> list[str]:
    return list(dict.fromkeys(body.zones)) or [zone for zone in zones if caller.sees(zone)]
