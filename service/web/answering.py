"""How a route is declared, and what it answers with: a record as JSON, events, or that its zone has nothing to tell."""

import math
from collections.abc import AsyncIterator, Callable, Sequence
from datetime import datetime
from functools import reduce, wraps
from http import HTTPStatus
from inspect import iscoroutinefunction, signature
from operator import or_
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from service.records.record import document, document_of
from service.records.update import Update
from service.records.view import Answer, Question, ZoneView
from service.web.limits import stream_slot
from service.web.problems import RETRY_SECONDS, documented
from service.web.server.refusal import RequestRefused

_EVENTS = "text/event-stream"

Language = Annotated[Literal["en", "de"], Query(description="of the sentences")]

Route = Callable[..., Any]
"""Takes `site`, `view` if it is about a zone, and what else it asks for; returns a record, or an answer of its own."""


def route(
    router: APIRouter,
    asked: str,
    *kinds: type,
    refused: Sequence[int] = (404, 422, 500, 503),
    also: Sequence[int] = (),
    responses: dict[int | str, dict[str, Any]] | None = None,
    **described: Any,
) -> Callable[[Route], Route]:
    """Decorator: a route, `asked` for as "GET /zones/{zone}/skill", which answers with a record of one of `kinds`, or
    with a problem of a status in `refused` or `also`. The OpenAPI document says of it what its docstring does.

    One that is no coroutine runs on a thread, where its record is written too.
    """
    method, path = asked.split()

    def add(function: Route) -> Route:
        @wraps(function)
        async def answered(site: Any, **given: Any) -> Response:
            def written(found: Any) -> Response:
                zone = given["view"].id if "view" in given else None
                return found if isinstance(found, Response) else json_answer(document(found, site.id, zone))

            if iscoroutinefunction(function):
                return written(await function(site=site, **given))
            return await run_in_threadpool(lambda: written(function(site=site, **given)))

        of_a_zone, answered.__doc__ = "view" in signature(function).parameters, None
        # Otherwise its answer would leave out what zone it is of.
        assert of_a_zone == ("{zone}" in path), f"{path}: its zone is {{zone}} in the path and the argument `view`"
        if kinds:
            described["response_model"] = reduce(or_, (document_of(kind, of_a_zone) for kind in kinds))
        told = documented(*sorted({*refused, *also})) | (responses or {})
        router.add_api_route(path, answered, methods=[method], responses=told, summary=function.__doc__, **described)
        return function

    return add


def streaming(text: str) -> dict[str, Any]:
    """What `route` is told of one that answers with server-sent events, which are `text`."""
    kind = {"description": f"Server-sent events: {text}", "content": {_EVENTS: {"schema": {"type": "string"}}}}
    return {"responses": {200: kind}, "response_class": Response, "dependencies": [Depends(stream_slot)]}


def streamed(events: AsyncIterator[bytes]) -> Response:
    """Server-sent events as they come."""
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(events, headers=headers, media_type=_EVENTS)


def json_answer(content: bytes) -> Response:
    return Response(content, media_type="application/json")


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
    status = zone.now().status
    sentence = f"zone '{zone.id}' has no forecast now ({status.state}): {status.reason or 'no sample yet'}"
    retry = max(1, min(RETRY_SECONDS, math.ceil(zone.period)))
    return RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], retry_after=retry)


def epoch(when: datetime | None) -> int | None:
    """The first whole UTC second not before `when`."""
    return None if when is None else math.ceil(when.timestamp())
