"""The history of a zone as JSON: read and written some rows at a time, so that a long one takes neither the journal
from the zones, nor the interpreter from the event loop, nor much memory."""

from __future__ import annotations

from collections.abc import Sequence

from fastapi.concurrency import run_in_threadpool

from service.errors import ServiceError
from service.records.asker import Asker, current_asker
from service.records.history import History, HistoryRow
from service.records.record import document, to_json, with_items
from service.records.view import ZoneView
from service.web.limits import LARGE, Limiter

PAGE = 1000
"""Rows that are read and written at a time. A history of no more waits for no other one."""


class Histories:
    """Writes the histories of the zones of `site`, long ones in turn."""

    def __init__(self, site: str, limiter: Limiter) -> None:
        self._site = site
        self._limiter = limiter

    async def answer(self, zone: ZoneView, start: int | None, end: int | None, limit: int) -> bytes:
        """A History as JSON, of the newest `limit` rows with `start` <= time < `end` (UTC s, None: open). Raises
        ServiceError where the journal fails, or the client has gone meanwhile."""
        asker = current_asker() or Asker()
        if limit <= PAGE:
            return await self._written(zone, start, end, limit, asker)
        async with self._limiter.turn(LARGE):
            return await self._written(zone, start, end, limit, asker)

    async def _written(self, zone: ZoneView, start: int | None, end: int | None, limit: int, asker: Asker) -> bytes:
        pages: list[bytes] = []
        while limit > 0:
            if asker.gone.is_set():
                raise ServiceError("the history was given up because nobody waits for it")
            rows = await zone.history(start, end, min(limit, PAGE))
            if not rows:
                break
            pages.append(await run_in_threadpool(_listed, rows))
            # A damaged row is left out, and counts all the same.
            limit, end = limit - PAGE, rows[0].time
        about = document(history_of(zone, ()), self._site, zone.id)
        return with_items(about, reversed(pages))


def history_of(zone: ZoneView, rows: Sequence[HistoryRow]) -> History:
    """`rows` of the history of `zone`."""
    return History(zone.network.measured[0], zone.period, tuple(rows))


def _listed(rows: Sequence[HistoryRow]) -> bytes:
    """`rows` as they stand in the list of a History; one by one, for what takes long in one piece holds the
    interpreter."""
    return b",".join(map(to_json, rows))
