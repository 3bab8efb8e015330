"""The history of a zone as JSON: read and written some rows at a time, so that a long one takes neither the journal
from the zones, nor the interpreter from the event loop, nor much memory."""

from __future__ import annotations

from collections.abc import Sequence

from fastapi.concurrency import run_in_threadpool

from service.errors import ServiceError
from service.fields.times import utc
from service.publish.payloads import to_json, to_json_with
from service.records.asker import Asker, current_asker
from service.records.history import HistoryRow
from service.records.view import ZoneView
from service.web.limits import LargeAnswers
from service.web.models import HistoryPayload, HistoryRowPayload

PAGE = 1000
"""Rows that are read and written at a time. A history of no more waits for no other one."""


class Histories:
    """Writes the histories of the zones of `site`, long ones in turn."""

    def __init__(self, site: str) -> None:
        self._site = site
        self._large = LargeAnswers()

    async def answer(self, zone: ZoneView, start: int | None, end: int | None, limit: int) -> bytes:
        """HistoryPayload as JSON, of the newest `limit` rows with `start` <= time < `end` (UTC s, None: open). Raises
        ServiceError where the journal fails, or the client has gone meanwhile."""
        asker = current_asker() or Asker()
        if limit <= PAGE:
            return await self._written(zone, start, end, limit, asker)
        async with self._large.turn():
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
        return to_json_with(history_payload(self._site, zone, ()), reversed(pages))


def history_payload(site: str, zone: ZoneView, rows: Sequence[HistoryRow]) -> HistoryPayload:
    """`rows` of the history of `zone`."""
    return HistoryPayload(
        site=site,
        zone=zone.id,
        output=zone.network.measured[0],
        period_s=zone.period,
        rows=[_payload(row) for row in rows],
    )


def _listed(rows: Sequence[HistoryRow]) -> bytes:
    """`rows` as they stand in the list of a HistoryPayload; one by one, for what takes long in one piece holds the
    interpreter."""
    return b",".join(to_json(_payload(row)) for row in rows)


def _payload(row: HistoryRow) -> HistoryRowPayload:
    return HistoryRowPayload(**row._asdict() | {"time": utc(row.time)})
