"""The route that keeps a connection open: a zone's events as they happen."""

from collections.abc import AsyncIterator
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Header, Response
from fastapi.concurrency import run_in_threadpool

from adapters.fields.times import parse_time
from service.publish.events import Event, event, events_of
from service.publish.sinks import TOPICS, Announcement, Reports
from service.records.record import document
from service.web.answering import Language, epoch, route, streamed, streaming
from service.web.history import history_of
from service.web.site import Asked, Here

MISSED_ROWS = 1000
"""Rows of the history that a client is given at most that comes back."""

router = APIRouter(tags=["zones"])


@route(
    router,
    "GET /zones/{zone}/stream",
    refused=(404, 422, 429, 500, 503),
    **streaming(f"{', '.join(TOPICS)}; history after a Last-Event-ID"),
)
async def stream(
    site: Here,
    view: Asked,
    last_event_id: Annotated[str | None, Header(description="id of the last event that came")] = None,
    language: Language = "en",
) -> Response:
    """Every new forecast, ahead, volatility, gate, gain, skill, trust and status as it is issued"""
    since, missed = epoch(_sample_time(last_event_id)), list[Event]()
    if since is not None and (rows := await view.history(since + 1, None, MISSED_ROWS)):
        written = await run_in_threadpool(lambda: document(history_of(view, rows), site.id, view.id))
        missed.append(event("history", written, None))

    async def events() -> AsyncIterator[bytes]:
        with site.streams.opened(view.id, language) as opened:
            state = view.now()
            reports = Reports(trust=state.trust, ahead=site.streams.ahead.get(view.id))
            opened.put([*missed, *events_of(Announcement(site.id, view.id, state, reports=reports), language)])
            async for data in opened.read():
                yield data

    return streamed(events())


def _sample_time(last_event_id: str | None) -> datetime | None:
    """The time that an id of ours names; None for anything else, which is then of no concern."""
    try:
        return parse_time(last_event_id or "")
    except ValueError:
        return None
