"""The route that the page of a room opens with: how it does, what it is like, and what to do."""

from __future__ import annotations

import math
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import Field

from service.forecast.answers import Room
from service.forecast.room import Past, RoomQuestion
from service.web.answering import asked
from service.web.models import Query as QueryModel
from service.web.site import Asked, Here, zone_route

_DAY = 86400
_POINTS = 48
"""Intervals of a day that are looked at."""


class RoomQuery(QueryModel):
    """Query of GET /zones/{zone}/room."""

    days: int = Field(default=7, ge=1, le=28, description="days up to the newest sample that are looked at")


router = APIRouter(prefix="/zones", tags=["zones"])


@zone_route(router, "GET /{zone}/room", Room)
async def room(site: Here, view: Asked, query: Annotated[RoomQuery, Query()]) -> Room:
    """How the room does, what it is like, and what to do, in sentences"""
    last = view.now().status.last_sample_time
    end = 0 if last is None else math.ceil(last + view.period)
    series = await view.series(end - query.days * _DAY, end, query.days * _POINTS + 1)
    question = RoomQuestion(Past.of(series), view.surroundings.floor_area, site.backend.time_zone)
    return await asked(view, question)
