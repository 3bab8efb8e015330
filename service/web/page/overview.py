"""The routes over all zones at a glance: one request for all of them, and one stream of what changes."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Any

from fastapi import APIRouter, Depends
from fastapi.responses import Response, StreamingResponse
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from service.publish.changes import Changes
from service.publish.events import RECONNECT_MS
from service.records.record import document, document_of
from service.records.update import Update
from service.records.view import ZoneView
from service.web.access import OVERVIEW_PREFIX, Asking, Caller
from service.web.limits import stream_slot
from service.web.page.outlook import LEADS, Outlook, Outlooks, Spark, scaled
from service.web.page.payloads import FindingName, OverviewChange, OverviewPayload, OverviewRow
from service.web.problems import documented

_MEDIA_TYPE = "text/event-stream"
_DESCRIBED: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Server-sent events: `rows`, an OverviewChange each",
        "content": {_MEDIA_TYPE: {"schema": {"type": "string"}}},
    }
}

PAUSE = 1.0
"""s between two events of one client: what changes meanwhile goes into one."""

ROWS_AT_ONCE = 100
"""Rows in an event; other requests have their turn before the next."""

_KEPT_SECONDS = 900.0
"""What was expected is shown for so many s of the zone's time, or three periods: with many zones it takes a while."""

_SILENT = ("stalled", "failed", "waiting")
"""States in which nobody vouches for what was expected."""


def overview_routes(
    site: str, time_zone: str | None, zones: Mapping[str, ZoneView], changes: Changes, outlooks: Outlooks
) -> APIRouter:
    """The routes over `zones`."""
    router = APIRouter(prefix=OVERVIEW_PREFIX, tags=["overview"])

    @router.get(
        "",
        response_model=document_of(OverviewPayload, of_a_zone=False),
        responses=documented(500),
        summary="Every zone at a glance",
    )
    def overview(caller: Asking) -> Response:
        rows = tuple(
            overview_row(zone, outlooks.outlooks.get(name), outlooks.sparks.get(name))
            for name, zone in tuple(zones.items())
            if caller.sees(name)
        )
        return Response(document(OverviewPayload(time_zone, rows), site), media_type="application/json")

    @router.get(
        "/stream",
        response_class=Response,
        responses={**_DESCRIBED, **documented(429, 500, 503)},
        dependencies=[Depends(stream_slot)],
        summary="What changes at a glance, at most once a second",
    )
    async def stream(caller: Asking) -> StreamingResponse:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        return StreamingResponse(_events(caller), headers=headers, media_type=_MEDIA_TYPE)

    async def _events(caller: Caller) -> AsyncIterator[bytes]:
        with changes.watched() as watcher, outlooks.watched():
            yield format_sse_event(retry=RECONNECT_MS)
            shown: dict[str, int] = {}
            while not watcher.ended:
                changed = [name for name in await watcher.changed() if caller.sees(name)]
                if not changed:
                    yield KEEPALIVE_COMMENT
                for first in range(0, len(changed), ROWS_AT_ONCE):
                    change = _change(changed[first : first + ROWS_AT_ONCE], shown)
                    yield format_sse_event(event="rows", data_str=document(change, site).decode())
                await watcher.rest(PAUSE)

    def _change(names: Sequence[str], shown: dict[str, int]) -> OverviewChange:
        """The rows of `names`; `shown` is of which time the client has the sparkline of each zone."""
        rows, removed = [], []
        for name in names:
            zone, spark = zones.get(name), outlooks.sparks.get(name)
            if zone is None:
                removed.append(name)
                shown.pop(name, None)
                continue
            news = spark is not None and shown.get(name) != spark.sample_time
            if spark is not None:
                shown[name] = spark.sample_time
            rows.append(overview_row(zone, outlooks.outlooks.get(name), spark if news else None))
        return OverviewChange(tuple(rows), tuple(removed))

    return router


def overview_row(zone: ZoneView, outlook: Outlook | None, spark: Spark | None) -> OverviewRow:
    """`zone` at a glance, with as much of its outlook and its last day as is known."""
    status, update = zone.status(), zone.latest()
    trust = zone.trust().at(scaled(LEADS[-1], zone.period))
    if status.state in _SILENT or (outlook is not None and _is_old(outlook, update, zone.period)):
        outlook = None
    return OverviewRow(
        zone.id,
        status.state,
        status.reason,
        zone.period,
        sample_time=None if update is None else update.time,
        temperature=math.nan if update is None else update.y[0],
        disturbed=update is not None and update.shown_gate.regime == _HIGH,
        expected=() if outlook is None else outlook.expected,
        expected_from=None if outlook is None else outlook.valid_time,
        trust=None if trust is None else trust.level,
        trust_reason="" if trust is None else trust.reason or zone.trust().beaten,
        findings=tuple(FindingName(one.finding, one.subject) for one in status.diagnosis.findings),
        spark=None if spark is None else spark.line,
    )


_HIGH = "high"


def _is_old(outlook: Outlook, update: Update | None, period: float) -> bool:
    """Whether `outlook` is of before the look at the table that is under way: nobody looks ahead while nobody looks."""
    return update is None or update.time - outlook.sample_time > max(3.0 * period, _KEPT_SECONDS)
