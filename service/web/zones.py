"""The routes under /zones."""

from __future__ import annotations

from collections.abc import Sequence
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Query, Response

from estimator.types import ParameterSummary
from service.errors import NoLaw, ServiceError
from service.forecast.answers import LearnedLaw
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
    refined,
    vouched,
)
from service.records.fan import Fan
from service.records.history import History
from service.records.outlook import SET_POINTS
from service.records.record import document_of, enclosed
from service.records.skill import Skill
from service.records.view import ZoneView
from service.web import planned
from service.web.access import Asking
from service.web.answering import answer, asked, epoch, json_answer, newest, no_forecast
from service.web.history import written
from service.web.models import (
    ChannelPayload,
    ForecastQuery,
    HistoryQuery,
    ParametersPayload,
    ParametersQuery,
    PriorPayload,
    QuantilesPayload,
    TermPayload,
    ZonePayload,
    ZonesPayload,
    ZonesQuery,
    ZoneSummary,
)
from service.web.problems import documented, invalid
from service.web.server.refusal import RequestRefused
from service.web.site import Asked, Here, zone_route

_HOUR = 3600.0


router = APIRouter(prefix="/zones", tags=["zones"])


@router.get(
    "",
    response_model=document_of(ZonesPayload, of_a_zone=False),
    responses=documented(422, 500),
    summary="Every zone and how it is doing",
)
def list_zones(site: Here, caller: Asking, query: Annotated[ZonesQuery, Query()]) -> Response:
    seen = [name for name in site.zones if caller.sees(name)]
    page = _page(seen, query)
    last = page[-1] if page and page[-1] != seen[-1] else None
    found = [site.zones[name] for name in page if name in site.zones]
    return answer(ZonesPayload(tuple(map(_summary, found)), last), site.id)


@router.get(
    "/{zone}",
    response_model=document_of(ZonePayload),
    responses=documented(404, 422, 500),
    summary="One zone: channels, parameters, status, faults",
)
async def show_zone(site: Here, view: Asked) -> Response:
    return answer(_description(site.id, view), site.id, view.id)


@zone_route(router, "GET /{zone}/forecast", ForecastPayload, FanPayload)
async def forecast(site: Here, view: Asked, query: Annotated[ForecastQuery, Query()]) -> ForecastPayload | FanPayload:
    """The standing forecast; with ?horizon= what follows it, inputs foreseen"""
    update = newest(view)
    published = published_levels(update)
    levels = query.level or published
    if query.horizon is None and set(levels) <= set(published):
        return _current(view, ForecastPayload.of(update, levels))
    request = ForecastRequest([view], query.horizon or 0.0, levels)
    if query.horizon is None:
        return _current(view, refined(await _fan(view, request)))
    bound(request)
    return _current(view, FanPayload.of_steps(await _fan(view, request)))


@zone_route(router, "POST /{zone}/forecast", FanPayload, also=(400,))
async def forecast_under_plan(site: Here, view: Asked, body: planned.ForecastRequest) -> FanPayload:
    """The forecast under planned inputs: what a controller asks"""
    newest(view)
    plan = Plan(inputs={view.id: planned.inputs_of(body.inputs)})
    request = ForecastRequest([view], body.horizon, body.levels, [plan])
    bound(request)
    if found := mistakes(request):
        raise invalid([f"field 'inputs.{one.channel}' {one.sentence}" for one in found])
    return _current(view, FanPayload.of_steps(await _fan(view, request), body.inputs))


@zone_route(router, "GET /{zone}/parameters", ParametersPayload)
async def parameters(site: Here, view: Asked, query: Annotated[ParametersQuery, Query()]) -> ParametersPayload:
    """Posterior quantiles of the parameters, time constants and the heat-loss coefficient"""
    found = await asked(view, ParametersQuestion(tuple(query.level)))
    return _parameters(view, query.level, *found)


@zone_route(router, "GET /{zone}/skill", Skill)
async def skill(site: Here, view: Asked) -> Skill:
    """What the zone's own forecasts were worth: one step, 1 h, 6 h and 24 h ahead"""
    return await asked(view, SkillQuestion())


@zone_route(router, "GET /{zone}/gain", GainPayload)
async def gain(site: Here, view: Asked) -> GainPayload:
    """Unmeasured heat into the zone and the noise of its sensors, where the estimator knows of them"""
    payload = GainPayload.of(newest(view))
    if payload is None:
        sentence = (
            f"the estimator '{view.estimator}' of zone '{view.id}' has no model of unmeasured heat; mkf and bank do"
        )
        raise RequestRefused(HTTPStatus.NOT_FOUND, [sentence])
    return payload


@zone_route(router, "GET /{zone}/history", History)
async def history(site: Here, view: Asked, query: Annotated[HistoryQuery, Query()]) -> Response:
    """Past samples against the forecasts that stood before them"""
    start, end = epoch(query.start), epoch(query.end)
    return json_answer(await written(site.id, view, start, end, query.limit, site.limiter))


def _current(view: ZoneView, payload: Forecasted) -> Forecasted:
    return vouched(payload, view.now().status, view.surroundings.limits)


def _page(names: Sequence[str], query: ZonesQuery) -> Sequence[str]:
    """The part of `names` that a query wants; RequestRefused where it goes on after a zone that there is not."""
    first = 0
    if query.after is not None:
        if query.after not in names:
            sentence = f"query parameter 'after': there is no zone '{query.after}' any more; begin with the first page"
            raise RequestRefused(HTTPStatus.UNPROCESSABLE_ENTITY, [sentence])
        first = names.index(query.after) + 1
    return names[first:] if query.limit is None else names[first : first + query.limit]


async def _fan(view: ZoneView, request: ForecastRequest) -> Fan:
    """The forecast of the one zone of `request` under its one plan."""
    (fan,) = await forecasts(request, request.plans[0])
    if fan is None:
        raise no_forecast(view)
    if isinstance(fan, NoLaw):
        raise invalid([f"field 'inputs.{SET_POINTS}': {fan}"])
    if isinstance(fan, ServiceError):
        raise fan
    return fan


def _summary(zone: ZoneView) -> ZoneSummary:
    status, network = zone.now().status, zone.network
    doing = (status.state, status.reason, status.samples, status.last_sample_time)
    about = (network.name, zone.estimator, zone.period, tuple(network.measured))
    return ZoneSummary(zone.id, *about, *doing)


def _description(site: str, zone: ZoneView) -> ZonePayload:
    network, state = zone.network, zone.now()
    channels = [
        ChannelPayload(channel, network.channel_unit(channel), "output" if channel in network.measured else "input")
        for channel in network.channels
    ]
    priors = [PriorPayload(p.name, p.unit, p.free, p.lower, p.upper, p.nominal) for p in network.parameters]
    status = enclosed(StatusPayload.of(state.status, state.update), site, zone.id)
    about = (network.name, network.description, zone.estimator, zone.period)
    return ZonePayload(*about, tuple(channels), tuple(priors), status)


def _parameters(
    zone: ZoneView, levels: Sequence[float], summary: ParameterSummary, laws: tuple[LearnedLaw, ...]
) -> ParametersPayload:
    network, diagnosis = zone.network, zone.now().status.diagnosis
    own = zip(network.parameters, summary.parameters, strict=True)
    known = zip(network.terms, summary.coefficients, strict=False)
    collapsed = iter(summary.collapsed.tolist())
    return ParametersPayload(
        network.name,
        tuple(levels),
        parameters=tuple(QuantilesPayload(p.name, p.unit, p.free, row, next(collapsed)) for p, row in own),
        time_constants=tuple(
            QuantilesPayload(f"tau_{rank}", "h", True, row / _HOUR, next(collapsed))
            for rank, row in enumerate(summary.time_constants, start=1)
        ),
        heat_loss=QuantilesPayload("heat_loss", "W/K", True, summary.heat_loss, next(collapsed)),
        known_heat=tuple(TermPayload(term.name, term.node, term.unit, row) for term, row in known),
        thermostat=laws,
        variants=tuple(sorted(diagnosis.variants, key=lambda each: -each.weight)),
        findings=diagnosis.findings,
    )
