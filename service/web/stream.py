"""The route that keeps a connection open: a zone's events as they happen."""

from __future__ import annotations

from collections.abc import AsyncIterator
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Depends, Header
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response, StreamingResponse

from adapters.fields.times import parse_time
from service.publish.events import Event, event, events_of
from service.publish.sinks import TOPICS, Announcement, Reports
from service.records.record import document
from service.records.view import ZoneView
from service.web.answering import described_events, epoch, events_answer
from service.web.history import history_of
from service.web.limits import stream_slot
from service.web.problems import documented
from service.web.site import Asked, Here, Site

MISSED_ROWS = 1000
"""Rows of the history that a client is given at most that comes back."""


router = APIRouter(prefix="/zones", tags=["zones"])


@router.get(
    "/{zone}/stream",
    response_class=Response,
    responses=described_events(f"{', '.join(TOPICS)}; history after a Last-Event-ID")
    | documented(404, 422, 429, 500, 503),
    dependencies=[Depends(stream_slot)],
    summary=f"Every new {', '.join(TOPICS[:-1])} and {TOPICS[-1]} as it is issued",
)
async def stream(
    site: Here,
    view: Asked,
    last_event_id: Annotated[str | None, Header(description="id of the last event that came")] = None,
) -> StreamingResponse:
    missed = await _missed(site.id, view, _sample_time(last_event_id))
    return events_answer(_events(site, view, missed))


async def _missed(site: str, view: ZoneView, after: datetime | None) -> list[Event]:
    """The rows that came after the client's last event."""
    since = epoch(after)
    rows = [] if since is None else await view.history(since + 1, None, MISSED_ROWS)
    if not rows:
        return []
    return [await run_in_threadpool(lambda: event("history", document(history_of(view, rows), site, view.id), None))]


async def _events(site: Site, view: ZoneView, missed: list[Event]) -> AsyncIterator[bytes]:
    with site.streams.opened(view.id) as opened:
        state = view.now()
        reports = Reports(trust=state.trust, ahead=site.streams.ahead.get(view.id))
        current = Announcement(site.id, view.id, state, reports=reports)
        opened.put([*missed, *events_of(current)])
        async for data in opened.read():
            yield data


def _sample_time(last_event_id: str | None) -> datetime | None:
    """The time that an id of ours names; None for anything else, which is then of no concern."""
    try:
        return parse_time(last_event_id or "")
    except ValueError:
        return None
