"""The history of a zone as JSON: read and written some rows at a time, so that a long one takes neither the journal
from the zones, nor the interpreter from the event loop, nor much memory."""

from collections.abc import Sequence
from contextlib import nullcontext

from fastapi.concurrency import run_in_threadpool

from service.errors import ServiceError
from service.records.asker import current_asker
from service.records.history import History, HistoryRow
from service.records.record import document, to_json, with_items
from service.records.view import ZoneView
from service.web.limits import LARGE, Limiter

PAGE = 1000
"""Rows that are read and written at a time. A history of no more waits for no other one."""


async def written(site: str, zone: ZoneView, start: int | None, end: int | None, limit: int, limiter: Limiter) -> bytes:
    """A History as JSON, of the newest `limit` rows with `start` <= time < `end` (UTC s, None: open); a long one in
    turn. Raises ServiceError where the journal fails, or the client has gone meanwhile."""
    asker, pages = current_asker(), list[bytes]()
    async with limiter.turn(LARGE) if limit > PAGE else nullcontext():
        while limit > 0:
            if asker.gone.is_set():
                raise ServiceError("the history was given up because nobody waits for it")
            rows = await zone.history(start, end, min(limit, PAGE))
            if not rows:
                break
            # One by one: what takes long in one piece holds the interpreter.
            pages.append(await run_in_threadpool(b",".join, map(to_json, rows)))
            # A damaged row is left out, and counts all the same.
            limit, end = limit - PAGE, rows[0].time
        return with_items(document(history_of(zone, ()), site, zone.id), reversed(pages))


def history_of(zone: ZoneView, rows: Sequence[HistoryRow]) -> History:
    return History(zone.network.measured[0], zone.period, tuple(rows))
