"""The routes under /zones."""

from collections.abc import Sequence
from http import HTTPStatus
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query, Response

from service.errors import NoLaw, ServiceError
from service.forecast.learned import ParametersQuestion, SkillQuestion
from service.forecast.plan import Plan
from service.forecast.request import ForecastRequest, bound, mistakes, published_levels
from service.forecast.site import forecasts
from service.publish.payloads import (
    FanPayload,
    Forecasted,
    ForecastPayload,
    GainPayload,
    StatusPayload,
    at_levels,
    steps,
    vouched,
)
from service.records.fan import Fan
from service.records.history import History
from service.records.outlook import SET_POINTS
from service.records.record import enclosed
from service.records.skill import Skill
from service.records.view import ZoneView
from service.web import planned
from service.web.access import Asking
from service.web.answering import asked, epoch, json_answer, newest, no_forecast, route
from service.web.history import written
from service.web.models import (
    ChannelPayload,
    Horizon,
    Instant,
    Levels,
    ParametersPayload,
    PriorPayload,
    QuantilesPayload,
    TermPayload,
    ZonePayload,
    ZonesPayload,
    ZoneSummary,
)
from service.web.problems import invalid
from service.web.server.refusal import RequestRefused
from service.web.site import Asked, Here

MAX_ROWS = 20_000
PARAMETER_LEVELS = (0.025, 0.5, 0.975)

_HOUR = 3600.0
_LEVEL = Query(
    description="probability content of a prediction interval, between 0 and 1; may be repeated",
    examples=[[0.5, 0.95]],
    default_factory=list,
)
_QUANTILE = Query(
    description="quantile level, between 0 and 1; may be repeated", default_factory=lambda: list(PARAMETER_LEVELS)
)

router = APIRouter(tags=["zones"])


@route(router, "GET /zones", ZonesPayload, refused=(422, 500))
def list_zones(
    site: Here,
    caller: Asking,
    limit: Annotated[int | None, Query(ge=1, le=MAX_ROWS, description="zones at most; without, all of them")] = None,
    after: Annotated[
        str | None, Query(max_length=64, description="the zone that the last page ended with, as `next` told it")
    ] = None,
) -> ZonesPayload:
    """Every zone and how it is doing"""
    seen, first = [name for name in site.zones if caller.sees(name)], 0
    if after is not None:
        if after not in seen:
            sentence = f"query parameter 'after': there is no zone '{after}' any more; begin with the first page"
            raise RequestRefused(HTTPStatus.UNPROCESSABLE_ENTITY, [sentence])
        first = seen.index(after) + 1
    page = seen[first:] if limit is None else seen[first : first + limit]
    last = page[-1] if page and page[-1] != seen[-1] else None
    return ZonesPayload(tuple(_summary(site.zones[name]) for name in page if name in site.zones), last)


def _summary(zone: ZoneView) -> ZoneSummary:
    status, network = zone.now().status, zone.network
    doing = (status.state, status.reason, status.samples, status.last_sample_time)
    return ZoneSummary(zone.id, network.name, zone.estimator, zone.period, tuple(network.measured), *doing)


@route(router, "GET /zones/{zone}", ZonePayload, refused=(404, 422, 500))
async def show_zone(site: Here, view: Asked) -> ZonePayload:
    """One zone: channels, parameters, status, faults"""
    network, state = view.network, view.now()
    return ZonePayload(
        network.name,
        network.description,
        view.estimator,
        view.period,
        tuple(
            ChannelPayload(channel, network.channel_unit(channel), "output" if channel in network.measured else "input")
            for channel in network.channels
        ),
        tuple(PriorPayload(p.name, p.unit, p.free, p.lower, p.upper, p.nominal) for p in network.parameters),
        enclosed(StatusPayload.of(state.status, state.update), site.id, view.id),
    )


@route(router, "GET /zones/{zone}/forecast", ForecastPayload, FanPayload)
async def forecast(
    site: Here,
    view: Asked,
    level: Annotated[Levels, _LEVEL],
    horizon: Annotated[
        Horizon | None, Query(description="how far beyond valid_time to forecast, inputs foreseen")
    ] = None,
) -> ForecastPayload | FanPayload:
    """The standing forecast; with ?horizon= what follows it, inputs foreseen"""
    update = newest(view)
    published = published_levels(update)
    levels = level or published
    if horizon is None and set(levels) <= set(published):
        return _current(view, ForecastPayload.of(update, at_levels(update, levels)))
    request = ForecastRequest([view], horizon or 0.0, levels)
    if horizon is None:
        fan = await _fan(view, request)
        return _current(view, ForecastPayload.of(fan.update, steps(fan)[0]))
    bound(request)
    return _current(view, FanPayload.of_steps(await _fan(view, request)))


@route(router, "POST /zones/{zone}/forecast", FanPayload, also=(400,))
async def forecast_under_plan(site: Here, view: Asked, body: planned.ForecastRequest) -> FanPayload:
    """The forecast under planned inputs: what a controller asks"""
    newest(view)
    plan = Plan(inputs={view.id: body.inputs})
    request = ForecastRequest([view], body.horizon, body.levels, [plan])
    bound(request)
    if found := mistakes(request):
        raise invalid([f"field 'inputs.{one.channel}' {one.sentence}" for one in found])
    return _current(view, FanPayload.of_steps(await _fan(view, request), body.inputs))


def _current(view: ZoneView, payload: Forecasted) -> Forecasted:
    return vouched(payload, view.now().status, view.surroundings.limits)


async def _fan(view: ZoneView, request: ForecastRequest) -> Fan:
    (fan,) = await forecasts(request, request.plans[0])
    if fan is None:
        raise no_forecast(view)
    if isinstance(fan, NoLaw):
        raise invalid([f"field 'inputs.{SET_POINTS}': {fan}"])
    if isinstance(fan, ServiceError):
        raise fan
    return fan


@route(router, "GET /zones/{zone}/parameters", ParametersPayload)
async def parameters(site: Here, view: Asked, level: Annotated[Levels, _QUANTILE]) -> ParametersPayload:
    """Posterior quantiles of the parameters, time constants and the heat-loss coefficient"""
    network, diagnosis = view.network, view.now().status.diagnosis
    summary, laws = await asked(view, ParametersQuestion(tuple(level)))
    collapsed = iter(summary.collapsed.tolist())

    def quantities(about: Sequence[tuple[str, str, bool]], rows: np.ndarray) -> tuple[QuantilesPayload, ...]:
        return tuple(QuantilesPayload(*one, row, next(collapsed)) for one, row in zip(about, rows, strict=True))

    known = zip(network.terms, summary.coefficients, strict=False)
    own = quantities([(p.name, p.unit, p.free) for p in network.parameters], summary.parameters)
    constants = [(f"tau_{rank}", "h", True) for rank in range(1, len(summary.time_constants) + 1)]
    return ParametersPayload(
        network.name,
        tuple(level),
        own,
        quantities(constants, summary.time_constants / _HOUR),
        QuantilesPayload("heat_loss", "W/K", True, summary.heat_loss, next(collapsed)),
        tuple(TermPayload(t.name, t.node, t.unit, row) for t, row in known),
        laws,
        tuple(sorted(diagnosis.variants, key=lambda each: -each.weight)),
        diagnosis.findings,
    )


@route(router, "GET /zones/{zone}/skill", Skill)
async def skill(site: Here, view: Asked) -> Skill:
    """What the zone's own forecasts were worth: one step, 1 h, 6 h and 24 h ahead"""
    return await asked(view, SkillQuestion())


@route(router, "GET /zones/{zone}/gain", GainPayload)
async def gain(site: Here, view: Asked) -> GainPayload:
    """Unmeasured heat into the zone and the noise of its sensors, where the estimator knows of them"""
    payload = GainPayload.of(newest(view))
    if payload is None:
        sentence = (
            f"the estimator '{view.estimator}' of zone '{view.id}' has no model of unmeasured heat; mkf and bank do"
        )
        raise RequestRefused(HTTPStatus.NOT_FOUND, [sentence])
    return payload


@route(router, "GET /zones/{zone}/history", History)
async def history(
    site: Here,
    view: Asked,
    start: Annotated[Instant | None, Query(description="first time, RFC 3339 with zone, included")] = None,
    end: Annotated[Instant | None, Query(description="last time, RFC 3339 with zone, excluded")] = None,
    limit: Annotated[int, Query(ge=1, le=MAX_ROWS, description="the newest rows are given")] = 1000,
) -> Response:
    """Past samples against the forecasts that stood before them"""
    return json_answer(await written(site.id, view, epoch(start), epoch(end), limit, site.limiter))
