"""What routes about a zone answer with: its records as JSON, or that it has nothing to tell now."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator
from datetime import datetime
from http import HTTPStatus
from typing import Any

from fastapi import Response
from fastapi.responses import StreamingResponse

from service.records.record import document
from service.records.update import Update
from service.records.view import Answer, Question, ZoneView
from service.web.problems import RETRY_SECONDS
from service.web.server.refusal import RequestRefused

_EVENTS = "text/event-stream"


def answer(record: object, site: str, zone: str | None = None) -> Response:
    """A record as JSON, with the site and the zone."""
    return json_answer(document(record, site, zone))


def json_answer(content: bytes) -> Response:
    """JSON that is written already."""
    return Response(content, media_type="application/json")


def events_answer(events: AsyncIterator[bytes]) -> StreamingResponse:
    """Server-sent events, as they come."""
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(events, headers=headers, media_type=_EVENTS)


def described_events(text: str) -> dict[int | str, dict[str, Any]]:
    """The `responses` of a route of server-sent events."""
    return {200: {"description": f"Server-sent events: {text}", "content": {_EVENTS: {"schema": {"type": "string"}}}}}


async def asked(zone: ZoneView, question: Question[Answer | None]) -> Answer:
    """The answer of `zone` to `question`; RequestRefused where it has none now."""
    found = await zone.ask(question)
    if found is None:
        raise no_forecast(zone)
    return found


def newest(zone: ZoneView) -> Update:
    """The newest update of `zone`; RequestRefused before the first."""
    update = zone.now().update
    if update is None:
        raise no_forecast(zone)
    return update


def no_forecast(zone: ZoneView) -> RequestRefused:
    """The refusal of a zone that has no forecast now."""
    status = zone.now().status
    sentence = f"zone '{zone.id}' has no forecast now ({status.state}): {status.reason or 'no sample yet'}"
    retry = max(1, min(RETRY_SECONDS, math.ceil(zone.period)))
    return RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], retry_after=retry)


def epoch(when: datetime | None) -> int | None:
    """The first whole UTC second not before `when`."""
    return None if when is None else math.ceil(when.timestamp())
