"""Questions about heating: GET /zones/{zone}/preheat, and POST .../demand, .../what-if and /demand."""

import asyncio
from datetime import UTC
from http import HTTPStatus
from typing import Annotated
from zoneinfo import ZoneInfo

from fastapi import APIRouter, Query
from pydantic import AfterValidator, BaseModel, Field

from service.errors import Away, NoLaw, PlanError
from service.forecast.answers import Comparison, Demand, Preheat, SiteDemand, ZoneTotal
from service.forecast.heating import (
    Called,
    CompareQuestion,
    Course,
    DemandQuestion,
    PreheatQuestion,
    check_until,
    moment,
    refusal,
    together,
)
from service.forecast.plan import Grid, Plan, Values, check, check_price
from service.forecast.request import ForecastRequest, bound, steps_of
from service.records.outlook import SET_POINTS
from service.records.view import Answer, Question, ZoneView
from service.web.access import Asking, find_zone
from service.web.answering import asked, newest, route
from service.web.models import Finite, Horizon
from service.web.planned import PlannedInput, PlannedPrice, named_apart
from service.web.problems import invalid
from service.web.server.refusal import RequestRefused
from service.web.site import Asked, Here

_AT_ONCE = 4
"""Zones of a site's demand that are asked at once."""


class DemandBody(BaseModel, extra="forbid", strict=True):
    """Body of POST /zones/{zone}/demand."""

    horizon: Horizon = Field(description="from valid_time on; a whole number of periods")
    T_set: PlannedInput | None = Field(
        default=None, description="planned set-points, degC, as inputs are planned; by default they are foreseen"
    )


class SiteDemandBody(DemandBody):
    """Body of POST /demand."""

    zones: list[str] = Field(default_factory=list, max_length=2000, description="default: all")


class CourseBody(BaseModel, extra="forbid", strict=True):
    """A plan of set-points."""

    name: str = Field(max_length=64)
    T_set: PlannedInput = Field(description="degC, as inputs are planned")


class WhatIfBody(BaseModel, extra="forbid", strict=True):
    """Body of POST /zones/{zone}/what-if."""

    horizon: Horizon = Field(description="from valid_time on; a whole number of periods")
    plans: Annotated[list[CourseBody], AfterValidator(named_apart)] = Field(
        min_length=2, max_length=20, description="each other one is compared with the first"
    )
    price: PlannedPrice | None = Field(default=None, description="of a kWh, in any currency, as inputs are planned")


router = APIRouter(tags=["heating"])


@route(router, "GET /zones/{zone}/preheat", Preheat, also=(409,))
async def preheat(
    site: Here,
    view: Asked,
    target: Annotated[
        Finite, Query(description="temperature to reach, degC, within what may be planned as a set-point")
    ],
    by: Annotated[
        str,
        Query(
            max_length=40,
            description="when: the next time of day in the site's time zone, such as 06:30, or RFC 3339 with zone",
            examples=["06:30"],
        ),
    ],
    probability: Annotated[float, Query(gt=0.0, lt=1.0, description="of being warm in time")] = 0.9,
    tolerance: Annotated[
        float,
        Query(
            ge=0.1,
            le=3.0,
            description="K below the target at which the zone counts as warm: most thermostats stop short of it",
        ),
    ] = 0.5,
) -> Preheat:
    """The latest time to raise the set-point for the zone to be warm in time"""
    _check(view, 1, target, "query parameter 'target'")
    start, zone = newest(view).forecast.valid_time, site.backend.time_zone
    try:
        until = moment(by, start, UTC if zone is None else ZoneInfo(zone))
        check_until(until, start, view.period)
    except PlanError as error:
        # A plus sign in a query string means a space.
        hint = "; write + as %2B in a query" if " " in by else ""
        raise invalid([f"query parameter 'by' {error}{hint}"]) from None
    return await _answer(view, until - start, PreheatQuestion(target, until, probability, tolerance))


@route(router, "POST /zones/{zone}/demand", Demand, also=(400, 409))
async def demand(site: Here, view: Asked, body: DemandBody) -> Demand:
    """The energy that the zone's thermostat will call for, hour by hour"""
    called = await _answer(view, body.horizon, _demand(view, body))
    return called.demand


@route(router, "POST /demand", SiteDemand, also=(400,))
async def site_demand(site: Here, caller: Asking, body: SiteDemandBody) -> SiteDemand:
    """The energy that the thermostats of several zones will call for, and its sum"""
    seen = [zone for zone in site.zones if caller.sees(zone)]
    wanted = [find_zone(site.zones, zone, caller) for zone in dict.fromkeys(body.zones or seen)]
    turns = asyncio.Semaphore(_AT_ONCE)

    async def called(view: ZoneView) -> Called | str:
        async with turns:
            try:
                return await _answer(view, body.horizon, _demand(view, body))
            except RequestRefused as refused:
                if refused.status == HTTPStatus.UNPROCESSABLE_ENTITY:
                    raise invalid([f"zone '{view.id}': {refused}"]) from None
                return str(refused)
            except Away as error:
                return str(error)

    found = dict(zip((view.id for view in wanted), await asyncio.gather(*map(called, wanted)), strict=True))
    totals = [one.total for one in found.values() if isinstance(one, Called)]
    summed = await asyncio.to_thread(together, totals)
    rows = [
        ZoneTotal(zone, None, one) if isinstance(one, str) else ZoneTotal(zone, one.demand.total)
        for zone, one in found.items()
    ]
    return SiteDemand(body.horizon, summed, rows)


@route(router, "POST /zones/{zone}/what-if", Comparison, also=(400, 409))
async def what_if(site: Here, view: Asked, body: WhatIfBody) -> Comparison:
    """What other plans of set-points change: energy, cost, hours below the set-point"""
    steps = _steps(view, body.horizon, len(body.plans))
    courses = [
        Course(one.name, _check(view, steps, one.T_set, f"field 'plans[{place}].T_set'"))
        for place, one in enumerate(body.plans)
    ]
    if body.price is not None:
        _check(view, steps, body.price, "field 'price'", price=True)
    return await _answer(view, body.horizon, CompareQuestion(steps, courses, body.price))


def _demand(view: ZoneView, body: DemandBody) -> DemandQuestion:
    steps = _steps(view, body.horizon, 1)
    return DemandQuestion(steps, None if body.T_set is None else _check(view, steps, body.T_set, "field 'T_set'"))


def _steps(view: ZoneView, horizon: float, plans: int) -> int:
    request = ForecastRequest([view], horizon, [], [Plan()] * plans)
    bound(request)
    return steps_of(request, view)


def _check(view: ZoneView, steps: int, values: Values, place: str, *, price: bool = False) -> Values:
    """The set-points, or the `price`, of `steps` steps; RequestRefused where these cannot be planned."""
    grid = Grid(newest(view).forecast.valid_time, view.period, steps)
    try:
        if price:
            check_price(values, grid)
        else:
            check(values, SET_POINTS, view.network, view.surroundings.limits, grid)
    except PlanError as error:
        raise invalid([f"{place} {error}"]) from None
    return values


async def _answer(view: ZoneView, lead: float, question: Question[Answer | None]) -> Answer:
    """The answer to a question over `lead` s; RequestRefused where there is none to rely on."""
    if (why := refusal(view.now().trust, lead)) is not None:
        raise RequestRefused(HTTPStatus.CONFLICT, [f"zone '{view.id}' {why}"])
    try:
        return await asked(view, question)
    except NoLaw as error:
        raise RequestRefused(HTTPStatus.CONFLICT, [f"zone '{view.id}' cannot say: {error}"]) from None
