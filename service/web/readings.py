"""The routes that take readings: who posts is told what became of them, after it is on disk."""

import asyncio
import json
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from http import HTTPStatus
from itertools import islice
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import TypeAdapter, ValidationError
from starlette.requests import ClientDisconnect

from adapters.http.posted import Posted, from_lines, from_senml
from adapters.reading import Fault, Quality
from adapters.watched import Seldom
from service.records.receipt import Receipt
from service.records.record import document, document_of
from service.store.audit import AUDIT, about
from service.web.access import Asking
from service.web.answering import json_answer, route
from service.web.limits import POSTS
from service.web.models import EXAMPLES, PostedReading, PostedReadings
from service.web.problems import invalid, sentence_of
from service.web.server.bodies import check_json
from service.web.server.refusal import MOST_SENTENCES, RequestRefused
from service.web.site import Asked, Here, Site

MAX_VALUES = 20_000
"""Values in one request."""
RETRY_SECONDS = 1
_LONGEST = 300
"""Characters of a sentence about what somebody wrote."""
_JSON, _SENML, _LINES = "application/json", "application/senml+json", "text/plain"
_FORMATS = {_JSON: "json", _SENML: "senml", _LINES: "line_protocol"}
_KINDS = {
    HTTPStatus.BAD_REQUEST: "encoding",
    HTTPStatus.REQUEST_ENTITY_TOO_LARGE: "size",
    HTTPStatus.UNSUPPORTED_MEDIA_TYPE: "media_type",
}
_ENTRY: TypeAdapter[PostedReading] = TypeAdapter(PostedReading)
_TAKEN = document_of(Receipt, of_a_zone=False, name="ReadingsPayload")

Precision = Annotated[Literal["ns", "us", "ms", "s"], Query(description="line protocol: what the time stamps count")]


def reading_routes(site: Site, limit: int, malformed: Counter[str]) -> APIRouter:
    """Routes that take readings, in bodies of `limit` bytes, also of a packed one when it is unpacked; `malformed`
    counts by kind those that could not be read."""
    router, told = APIRouter(tags=["readings"]), Seldom()
    taking = partial(
        route,
        router,
        refused=(400, 401, 403, 404, 409, 413, 415, 422, 429, 500, 503),
        response_model=_TAKEN,
        openapi_extra={"requestBody": _documented_body()},
    )

    @taking("POST /readings")
    async def take_readings(site: Here, request: Request, caller: Asking, precision: Precision = "ns") -> Response:
        """Readings for the channels of all zones"""
        return await answered(request, precision, caller.name, None)

    @taking("POST /zones/{zone}/readings")
    async def take_readings_of_zone(
        site: Here, view: Asked, request: Request, caller: Asking, precision: Precision = "ns"
    ) -> Response:
        """Readings for the channels of one zone"""
        return await answered(request, precision, caller.name, view.id)

    async def answered(request: Request, precision: str, caller: str, zone: str | None) -> Response:
        take, headers, limiter = site.backend.take, request.headers, site.limiter
        if take is None:
            raise RequestRefused(HTTPStatus.CONFLICT, ["nobody takes readings here"])
        try:
            body = await request.body()
        except ClientDisconnect:
            # Nobody is there to hear an answer.
            return Response()
        limiter.admit_post()
        limiter.posted(len(body))
        # Who sends slowly keeps nobody waiting: the turn begins with the whole body.
        async with limiter.turn(POSTS):
            # A large body takes its time, for which the event loop must not wait.
            try:
                if "content-encoding" in headers:
                    packed = len(body)
                    body = await asyncio.to_thread(unpacked, body, headers, limit)
                    limiter.posted(max(0, len(body) - packed))
                posted = await asyncio.to_thread(read, body, headers, precision)
            except RequestRefused as error:
                complain(error, headers, caller)
                raise
            return json_answer(document(await take(posted, zone), site.id))

    def complain(error: RequestRefused, headers: Mapping[str, str], caller: str) -> None:
        """Count why a post that came with the key called `caller` was refused, and log it now and then."""
        kind = _KINDS.get(HTTPStatus(error.status)) or _FORMATS[_media_type(headers)]
        malformed[kind] += 1
        if told(kind):
            said = (caller, str(error)[:_LONGEST], kind, malformed[kind])
            sentence = "a post with the API key '%s' cannot be read: %s (%s: %d so far)"
            AUDIT.warning(sentence, *said, extra=about("unreadable", f"key {caller}"))

    return router


def _media_type(headers: Mapping[str, str]) -> str:
    return headers.get("content-type", "").partition(";")[0].strip().lower()


def read(body: bytes, headers: Mapping[str, str], precision: str) -> list[Posted]:
    """The values in the unpacked `body` of a request with `headers`. RequestRefused if it cannot be read as a whole."""
    media_type = _media_type(headers)
    readers: dict[str, Callable[[str], Iterator[Posted]]] = {
        _JSON: lambda text: _from_json(_document(text)),
        _SENML: lambda text: from_senml(_document(text), time.time()),
        _LINES: lambda text: from_lines(text, precision),
    }
    if media_type not in readers:
        given = f"not {media_type!r}" if media_type else "and this request has none"
        sentence = f"Content-Type must be {_JSON}, {_SENML}, or {_LINES} for InfluxDB line protocol, {given}"
        raise RequestRefused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, [sentence])
    try:
        values = list(islice(readers[media_type](body.decode("utf-8-sig")), MAX_VALUES + 1))
    except UnicodeDecodeError:
        raise RequestRefused(HTTPStatus.BAD_REQUEST, ["the body is not text in UTF-8"]) from None
    except ValueError as error:
        sentence = f"the body {error}" if media_type == _SENML else str(error)
        raise invalid([sentence[:_LONGEST]]) from None
    if len(values) > MAX_VALUES:
        raise _too_many()
    return values


def unpacked(body: bytes, headers: Mapping[str, str], limit: int) -> bytes:
    """The `body` of a request with `headers` as it was before it was packed, `limit` bytes at most. RequestRefused."""
    encoding = headers["content-encoding"].strip().lower()
    if encoding == "identity":
        return body
    if encoding != "gzip":
        sentence = f"Content-Encoding must be gzip or none, not {encoding!r}"
        raise RequestRefused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, [sentence])
    unpacking = zlib.decompressobj(zlib.MAX_WBITS | 16)
    try:
        content = unpacking.decompress(body, limit + 1)
    except zlib.error:
        raise RequestRefused(HTTPStatus.BAD_REQUEST, ["the body is not packed with gzip"]) from None
    if len(content) > limit:
        sentence = f"the body is larger than {limit} bytes when it is unpacked"
        raise RequestRefused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, [sentence])
    if not unpacking.eof or unpacking.unused_data:
        raise RequestRefused(HTTPStatus.BAD_REQUEST, ["the body is not one whole gzip stream"])
    if _media_type(headers) in (_JSON, _SENML):
        check_json(content)
    return content


def _document(text: str) -> Any:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        raise invalid(["the body is not JSON"]) from None
    # What is too much is not looked at.
    if isinstance(document, list) and len(document) > MAX_VALUES:
        raise _too_many()
    return document


def _from_json(document: object) -> Iterator[Posted]:
    entries = document.get("readings") if isinstance(document, dict) and document.keys() == {"readings"} else None
    if not isinstance(entries, list):
        raise invalid(['the body must be an object with one list: {"readings": [...]}'])
    if len(entries) > MAX_VALUES:
        raise _too_many()
    mistakes: list[str] = []
    for place, entry in enumerate(entries):
        try:
            found = _ENTRY.validate_python(entry)
        except ValidationError as error:
            mistakes += [
                sentence_of(detail | {"loc": ("body", "readings", place, *detail["loc"])}) for detail in error.errors()
            ]
            if len(mistakes) > MOST_SENTENCES:
                raise invalid(mistakes) from None
            continue
        if not mistakes:
            when = None if found.time is None else found.time.timestamp()
            value = Fault.NOT_AVAILABLE if found.value is None else found.value
            yield Posted(found.channel, value, when, quality=Quality(found.quality), unit=found.unit)
    if mistakes:
        raise invalid(mistakes)


def _too_many() -> RequestRefused:
    sentence = f"a request holds at most {MAX_VALUES} values; post fewer at a time (Telegraf: metric_batch_size)"
    return RequestRefused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, [sentence])


def _documented_body() -> dict[str, Any]:
    """The body in the OpenAPI document: three formats."""
    pack = {"type": "array", "items": {"type": "object"}, "examples": EXAMPLES["SenML"]}
    lines = {"type": "string", "examples": EXAMPLES["line protocol"]}
    posted = {"$ref": f"#/components/schemas/{PostedReadings.__name__}"}
    schemas = {_JSON: posted, _SENML: pack, _LINES: lines}
    return {"required": True, "content": {kind: {"schema": schema} for kind, schema in schemas.items()}}
