"""Long histories: page by page, the same answer as in one piece, and few of them at a time."""

import asyncio

import pytest
from fastapi import FastAPI
from prometheus_client import CollectorRegistry
from support.fake_zones import PERIOD, START, FakeZone, make_update, running
from support.http_client import get
from support.waiting import until

from service.errors import ServiceError
from service.records.asker import Asker, asked_by
from service.records.history import HistoryRow
from service.records.record import document
from service.web.app import create_app
from service.web.history import PAGE, history_of, written
from service.web.limits import LARGE, Limiter

ROWS = 2 * PAGE + 300


@pytest.fixture(scope="module")
def zone() -> FakeZone:
    long = running("living")
    long.updates = [make_update(step) for step in range(ROWS)]
    return long


@pytest.fixture(scope="module")
def app(zone: FakeZone) -> FastAPI:
    return create_app("htwg", {"living": zone}, CollectorRegistry())


@pytest.mark.parametrize("limit", [1, PAGE, PAGE + 1, 20_000])
@pytest.mark.parametrize("start", [None, START + 500 * PERIOD])
def test_pages_make_the_answer_of_one_piece(app: FastAPI, zone: FakeZone, limit: int, start: int | None) -> None:
    zone.asked.clear()
    query = f"limit={limit}" + ("" if start is None else "&start=2025-05-04T17:40:00Z")
    answer = get(app, f"/zones/living/history?{query}")
    assert answer.status_code == 200
    rows = [row for row in map(HistoryRow.of, zone.updates) if start is None or row.time >= start][-limit:]
    assert answer.content == document(history_of(zone, rows), "htwg", zone.id)
    assert all(asked[3] <= PAGE for asked in zone.asked), "a page leaves the journal to the zones"


class Slow:
    """A zone whose history is read when `open` is set; who has asked for it is noted."""

    def __init__(self, zone: FakeZone) -> None:
        self.network, self.period, self.id = zone.network, zone.period, zone.id
        self.open, self.reading = asyncio.Event(), list[int]()

    async def history(self, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        self.reading.append(limit)
        await self.open.wait()
        return []


async def test_one_client_leaves_room_for_another_and_short_histories_wait_for_none(zone: FakeZone) -> None:
    limiter, slow = Limiter(), Slow(zone)

    async def ask(name: str, limit: int) -> bytes:
        asked_by(Asker(name))
        return await written("htwg", slow, None, None, limit, limiter)

    greedy = [asyncio.create_task(ask("greedy", 20_000)) for _ in range(5)]
    await until(lambda: slow.reading)
    others = [asyncio.create_task(ask(f"client {k}", 20_000)) for k in range(5)]
    await until(lambda: len(slow.reading) == 2)
    short = asyncio.create_task(ask("greedy", PAGE))
    await until(lambda: len(slow.reading) == 2 + 1)
    slow.open.set()
    await asyncio.gather(*greedy, *others, short)
    assert len(slow.reading) == 11
    assert limiter.open(LARGE) == 0


async def test_nothing_is_read_for_a_client_that_has_gone(zone: FakeZone) -> None:
    asker, slow = Asker("gone"), Slow(zone)
    asker.gone.set()
    asked_by(asker)
    with pytest.raises(ServiceError, match="nobody waits for it"):
        await written("htwg", slow, None, None, 20_000, Limiter())
    assert slow.reading == []
