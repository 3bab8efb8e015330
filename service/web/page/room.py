"""The route that the page of a room opens with: how it does, what it is like, and what to do."""

from typing import Annotated

from fastapi import APIRouter, Query, Response

from estimator.arrays import DAY
from service.forecast.answers import Room
from service.forecast.room import Past, RoomQuestion
from service.publish.language import told_in
from service.records.record import document
from service.web.answering import Language, asked, json_answer, route
from service.web.page.series import end_of
from service.web.site import Asked, Here

DAYS = 7
"""Days that are looked at, unless others are asked for."""
POINTS = 48
"""Intervals of a day that are looked at."""

router = APIRouter(tags=["zones"])


@route(router, "GET /zones/{zone}/room", Room)
async def room(
    site: Here,
    view: Asked,
    days: Annotated[int, Query(ge=1, le=28, description="days up to the newest sample that are looked at")] = DAYS,
    language: Language = "en",
) -> Response:
    """How the room does, what it is like, and what to do, in sentences"""
    end = end_of(view)
    series = await view.series(end - days * DAY, end, days * POINTS + 1)
    about = view.surroundings
    question = RoomQuestion(Past.of(series), about.floor_area, site.backend.time_zone, about.entered)
    found = await asked(view, question)
    return json_answer(told_in(language, document(found, site.id, view.id)))
