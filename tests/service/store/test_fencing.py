"""Two owners: what was one's is the other's now, and nothing that the first one still sends is written."""

from __future__ import annotations

import asyncio
import itertools
import logging
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_zones import make_sample, make_update
from support.postgres import Server
from support.waiting import wait_until

import service.store.postgres.database as database
import service.store.postgres.leases as leases_module
import service.store.retention as retention
from adapters.reading import Reading
from service.errors import Fenced, JournalError, LeaseHeld, StateMismatch
from service.store.checkpoint import Checkpoint
from service.store.postgres.leases import Lease, Leases
from service.store.postgres.partitions import month_of
from service.store.postgres.store import PostgresStore
from service.store.retention import Limits

LONG = 600.0
_sites = itertools.count()


class Fleet:
    """The leases of a site of its own, and stores under them."""

    def __init__(self, server: Server) -> None:
        self.server, self.site = server, f"fenced-{next(_sites)}"
        self.leases = Leases(server.connection, self.site)
        self.opened: list[PostgresStore] = []

    def store(self, lease: Lease) -> PostgresStore:
        self.opened.append(PostgresStore(self.server.connection, self.site, lease))
        return self.opened[-1]

    def sql(self, statement: str) -> list[tuple[Any, ...]]:
        """Run a statement with {} for the schema."""
        return self.server.run(statement.format(f'"thermogate_{self.site}"'))

    def expire(self, lease: Lease) -> None:
        """As if its time were over."""
        self.sql(f"UPDATE {{}}.leases SET expires = clock_timestamp() WHERE name = '{lease.name}'")


@pytest.fixture
def fleet(postgres_server: Server) -> Iterator[Fleet]:
    made = Fleet(postgres_server)
    yield made
    for store in made.opened:
        store.close()
    made.leases.close()


def test_a_lease_has_one_owner_until_it_expires_or_is_released(fleet: Fleet) -> None:
    first = fleet.leases.acquire("shard", "node-1", LONG)
    assert first[:3] == ("shard", "node-1", 1)
    assert first.is_safe(LONG - 60)
    assert not first.is_safe(LONG + 1)
    with pytest.raises(LeaseHeld, match=r"the lease 'shard' belongs to node-1 for [56]") as held:
        fleet.leases.acquire("shard", "node-2", LONG)
    assert LONG - 60 < held.value.seconds <= LONG
    assert fleet.leases.acquire("other", "node-2", LONG).epoch == 1
    fleet.expire(first)
    second = fleet.leases.acquire("shard", "node-2", LONG)
    assert second.epoch == 2
    with pytest.raises(Fenced, match=r"the lease 'shard' of node-1 \(epoch 1\) has gone to another owner"):
        fleet.leases.renew(first, LONG)
    fleet.leases.release(first)
    assert fleet.leases.renew(second, 2 * LONG).is_safe(LONG), "an old owner cannot give it away"
    fleet.leases.release(second)
    assert fleet.leases.acquire("shard", "node-3", LONG).epoch > second.epoch
    again = fleet.leases.acquire("shard", "node-3", LONG)
    assert again.epoch > second.epoch + 1, "the same owner, started again, need not wait; what it was before is fenced"


def test_a_lease_that_expired_and_was_not_taken_is_renewed(fleet: Fleet) -> None:
    lease = fleet.leases.acquire("shard", "node-1", LONG)
    fleet.expire(lease)
    assert fleet.leases.renew(lease, LONG).is_safe()


@pytest.mark.parametrize("skew", [-300.0, -30.0, 30.0, 300.0])
def test_clocks_that_are_wrong_do_no_harm(fleet: Fleet, skew: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nodes whose clocks differ from the database's, and which were started at other times."""
    held = fleet.leases.acquire("shard", "node-1", 120.0)
    real, steady = time.time, leases_module.steady
    monkeypatch.setattr(time, "time", lambda: real() + skew)
    monkeypatch.setattr(leases_module, "steady", lambda: steady() + 1e6)
    with pytest.raises(LeaseHeld):
        fleet.leases.acquire("shard", "node-2", 120.0)
    other = fleet.leases.acquire("other", "node-2", 120.0)
    assert other.is_safe(1.0)
    assert not other.is_safe(121.0)
    monkeypatch.setattr(leases_module, "steady", steady)
    assert not held.is_safe(121.0)


def test_a_lease_is_never_thought_to_last_longer_than_the_database_has_it(fleet: Fleet) -> None:
    first = fleet.leases.acquire("shard", "node-1", 60.0)
    for lease in (first, fleet.leases.renew(first, LONG)):
        # The second one is still less than what the database has.
        ((left,),) = fleet.sql("SELECT extract(epoch FROM expires - clock_timestamp())::float8 FROM {}.leases")
        assert lease.until - leases_module.steady() <= left + 0.001
    assert not first.is_safe(61.0)
    assert lease.is_safe(61.0)


Act = Callable[[PostgresStore], Any]


def _checkpoint(step: int) -> Checkpoint:
    return Checkpoint("f", step, {}, {})


async def _append(store: PostgresStore) -> None:
    await store.append("z", make_sample(1))


async def _keep(store: PostgresStore) -> None:
    await store.write(store.journal.keep, "z", [Reading("z/T_i", make_sample(1).time + 1.0, 20.0)])


async def _skip(store: PostgresStore) -> None:
    await store.write(store.journal.skip, "z", make_sample(0).time, "why not")


async def _save(store: PostgresStore) -> None:
    await asyncio.to_thread(store.checkpoints.save, "z", _checkpoint(2))


async def _set_checkpoints_aside(store: PostgresStore) -> None:
    await asyncio.to_thread(store.checkpoints.set_aside, "z", 0)


async def _set_back(store: PostgresStore) -> None:
    await store.set_back("z", None, None, 0)


async def _forget(store: PostgresStore) -> None:
    await store.forget("z")


async def _give_up(store: PostgresStore) -> None:
    await store.give_up("z")


async def _record(store: PostgresStore) -> None:
    store.record("z", make_update(1))
    await store.write(store.journal.flush)


async def _take(store: PostgresStore) -> None:
    await store.take(["z"])


async def _prune(store: PostgresStore) -> None:
    await store.run(lambda: list(store._prune(Limits(1.0, 1.0))))


WRITING: dict[str, Act] = {
    "append": _append,
    "keep": _keep,
    "skip": _skip,
    "save a checkpoint": _save,
    "set checkpoints aside": _set_checkpoints_aside,
    "set back": _set_back,
    "forget": _forget,
    "give up": _give_up,
    "record": _record,
    "take": _take,
    "prune": _prune,
}


async def _filled(store: PostgresStore) -> None:
    await store.claim("z", "f")
    await store.append("z", make_sample(0))
    await asyncio.to_thread(store.checkpoints.save, "z", _checkpoint(1))


def _everything(fleet: Fleet) -> list[Any]:
    tables = ("zones", "samples", "history", "readings", "checkpoints", "leases")
    return [sorted(map(str, fleet.sql(f"SELECT * FROM {{}}.{table}"))) for table in tables]


@pytest.mark.parametrize("other", ["node-2", "node-1"])
@pytest.mark.parametrize("act", WRITING)
def test_who_has_lost_the_lease_writes_nothing(fleet: Fleet, act: str, other: str) -> None:
    """Also where the same owner has started again."""
    lease = fleet.leases.acquire("shard", "node-1", LONG)
    stale = fleet.store(lease)
    asyncio.run(_filled(stale))
    fleet.expire(lease)
    fleet.leases.acquire("shard", other, LONG)
    before = _everything(fleet)
    with pytest.raises(Fenced, match=r"the lease 'shard' of node-1 \(epoch 1\) has gone to another owner"):
        asyncio.run(WRITING[act](stale))
    assert _everything(fleet) == before
    assert any("has gone to another owner" in problem for problem in stale.problems())


@pytest.mark.parametrize("act", sorted(WRITING.keys() - {"record", "take", "prune", "forget", "give up"}))
async def test_who_has_lost_a_zone_writes_nothing_to_it(fleet: Fleet, act: str) -> None:
    stale = fleet.store(fleet.leases.acquire("shard-1", "node-1", LONG))
    other = fleet.store(fleet.leases.acquire("shard-2", "node-2", LONG))
    await _filled(stale)
    await stale.give_up("z")
    await other.claim("z", "f")
    before = _everything(fleet)
    with pytest.raises(Fenced, match=r"zone 'z' is not held by the lease 'shard-1' of node-1"):
        await WRITING[act](stale)
    assert _everything(fleet) == before
    assert stale.problems() == []


async def test_a_zone_that_another_one_holds_is_neither_taken_nor_reset_nor_pruned(fleet: Fleet) -> None:
    stale = fleet.store(fleet.leases.acquire("shard-1", "node-1", LONG))
    other = fleet.store(fleet.leases.acquire("shard-2", "node-2", LONG))
    await _filled(other)
    before = _everything(fleet)
    await stale.take(["z"])
    await stale.give_up("z")
    for attempt in (stale.claim("z", "f"), stale.forget("z")):
        with pytest.raises(Fenced, match=r"zone 'z' belongs to the lease 'shard-2' of node-2 for \d+ s more"):
            await attempt
    stale.record("z", make_update(1))
    await stale.write(stale.journal.flush)
    assert _everything(fleet) == before


async def test_a_zone_that_has_gone_does_not_take_the_commit_of_the_others_along(fleet: Fleet) -> None:
    store = fleet.store(fleet.leases.acquire("shard-1", "node-1", LONG))
    other = fleet.store(fleet.leases.acquire("shard-2", "node-2", LONG))
    for zone in "abc":
        await store.claim(zone, "f")
        store.record(zone, make_update(0))
    await store.give_up("b")
    await other.claim("b", "f")
    store.record("b", make_update(1))
    results = await asyncio.gather(*(store.append(zone, make_sample(0)) for zone in "abc"), return_exceptions=True)
    history = [len(await other.run(other.journal.history, zone, None, None, 10)) for zone in "abc"]
    assert history == [1, 1, 1]
    first, second, third = results
    assert (first, third) == (None, None)
    assert isinstance(second, Fenced)
    assert second.zones == ("b",)
    assert [len(await other.samples_after(zone, None)) for zone in "ab"] == [1, 0]


async def test_the_zones_of_an_owner_that_is_gone_are_taken_one_by_one_and_it_is_fenced(fleet: Fleet) -> None:
    lease = fleet.leases.acquire("shard-1", "node-1", LONG)
    gone, other = fleet.store(lease), fleet.store(fleet.leases.acquire("shard-2", "node-2", LONG))
    for zone in "ab":
        await gone.claim(zone, "f")
        await gone.append(zone, make_sample(0))
    fleet.expire(lease)
    await other.take(["a", "b", "new"])
    await other.claim("a", "f")
    await other.append("a", make_sample(1))
    with pytest.raises(Fenced, match="has gone to another owner"):
        await gone.append("b", make_sample(1))
    with pytest.raises(Fenced):
        fleet.leases.renew(lease, LONG)
    await other.append("b", make_sample(1))
    assert [len(await other.samples_after(zone, None)) for zone in "ab"] == [2, 2]


def test_a_lease_is_not_taken_in_the_middle_of_a_transaction_and_renewed_meanwhile(fleet: Fleet) -> None:
    lease = fleet.leases.acquire("shard", "node-1", LONG)
    store = fleet.store(lease)
    asyncio.run(_filled(store))
    fleet.expire(lease)
    writing, told = threading.Event(), threading.Event()

    def work(cursor: Any) -> None:
        store._fence.required(cursor, ["z"])
        writing.set()
        assert told.wait(180)
        cursor.execute("UPDATE samples SET skipped = 'late'")

    writer = threading.Thread(target=lambda: store._database.transaction(work))
    writer.start()
    assert writing.wait(180)
    renewed = fleet.leases.renew(lease, LONG)
    assert renewed.is_safe(), "renewing waits for nobody"
    fleet.expire(lease)
    taken: list[Lease] = []
    other = Leases(fleet.server.connection, fleet.site)
    taker = threading.Thread(target=lambda: taken.append(other.acquire("shard", "node-2", LONG)))
    taker.start()
    wait_until(lambda: fleet.sql("SELECT 1 FROM pg_stat_activity WHERE wait_event_type = 'Lock'"))
    assert not taken
    told.set()
    writer.join()
    taker.join()
    other.close()
    assert taken[0].epoch == 2
    assert fleet.sql("SELECT skipped FROM {}.samples") == [("late",)], "it was written before the lease went"


def test_an_owner_that_froze_in_the_middle_of_a_transaction_keeps_nobody_waiting(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    lease = fleet.leases.acquire("shard", "node-1", LONG)
    store = fleet.store(lease)
    asyncio.run(_filled(store))
    fleet.expire(lease)
    monkeypatch.setattr(database, "FROZEN_SECONDS", 1.0)
    fleet.server.disconnect()
    waited = threading.Event()

    def work(cursor: Any) -> None:
        store._fence.required(cursor, ["z"])
        if not waited.is_set():
            assert fleet.leases.acquire("shard", "node-2", LONG).epoch == 2
            waited.set()
        cursor.execute("UPDATE samples SET skipped = 'stale'")

    with pytest.raises(Fenced):
        store._database.transaction(work)
    assert waited.is_set()
    assert fleet.sql("SELECT skipped FROM {}.samples") == [(None,)]


async def test_months_are_made_by_one_of_many_and_dropped_when_nothing_in_them_stays(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    stores = [fleet.store(fleet.leases.acquire(f"shard-{n}", f"node-{n}", LONG)) for n in range(3)]
    month = 31 * 86_400
    times = [make_sample(0).time + k * month for k in range(4)]
    for number, store in enumerate(stores):
        await store.claim(f"z{number}", "f")
    for when in times:
        await asyncio.gather(
            *(store.append(f"z{n}", make_sample(0)._replace(time=when)) for n, store in enumerate(stores))
        )
    # A zone that nobody serves any more.
    await stores[0].claim("left", "f")
    for when in times:
        await stores[0].append("left", make_sample(0)._replace(time=when))
    await asyncio.to_thread(stores[0].checkpoints.save, "left", _checkpoint(times[-1]))
    await stores[0].give_up("left")
    for number, store in enumerate(stores):
        store.record(f"z{number}", make_update(0)._replace(time=times[0]))
        await store.write(store.journal.flush)
        await asyncio.to_thread(store.checkpoints.save, f"z{number}", _checkpoint(times[number] + 2 * 86_400))
    assert _months(fleet) == sorted(
        [month_of("samples", when).name for when in times] + [month_of("history", times[0]).name]
    )
    there = _months(fleet)
    for leap in (retention.LEAP, month):
        assert _months(fleet) == there, "a leap in time makes nothing old"
        monkeypatch.setattr(retention, "LEAP", leap)
        for store in stores:
            await store.run(lambda store=store: list(store._prune(Limits(1.5 * month, 1e12))))
    stays = [month_of("samples", when).name for when in times[1:]]
    assert _months(fleet) == sorted(stays), "z0 needs what follows its checkpoint in the first one"
    for number, store in enumerate(stores):
        await store.append(f"z{number}", make_sample(0)._replace(time=times[-1] + 1))
        found = [item.time for item in await store.samples_after(f"z{number}", times[number])]
        assert found == [*times[number + 1 :], times[-1] + 1], "the chain goes on"
    await stores[1].claim("left", "f")
    assert [item.time for item in await stores[1].samples_after("left", None)] == times[1:]
    assert await stores[1].resume_after("left", times[-1]) == times[-1]
    # A month that was dropped is made anew for a zone that comes with an old recording.
    await stores[0].claim("old", "f")
    await stores[0].append("old", make_sample(0))
    assert month_of("samples", times[0]).name in _months(fleet)


async def test_a_month_that_another_shard_has_dropped_is_made_anew_at_once(
    fleet: Fleet, caplog: pytest.LogCaptureFixture
) -> None:
    store = fleet.store(fleet.leases.acquire("shard-1", "node-1", LONG))
    for zone in ("z", "old"):
        await store.claim(zone, "f")
    await store.append("z", make_sample(0))
    store.record("z", make_update(0)._replace(time=make_sample(0).time))
    await store.write(store.journal.flush)
    for table in ("samples", "history"):
        fleet.sql(f"DROP TABLE {{}}.{month_of(table, make_sample(0).time).name}")
    store.record("old", make_update(0)._replace(time=make_sample(0).time))
    await store.append("old", make_sample(0))
    assert await store.run(store.journal.last_sample_time, "old") == make_sample(0).time
    assert len(await store.run(store.journal.history, "old", None, None, 10)) == 1
    assert not [
        record for record in caplog.records if record.levelno >= logging.WARNING and "fsync" not in record.message
    ]


def test_a_row_that_comes_while_its_month_is_dropped_stays(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "FROZEN_SECONDS", 120.0)
    monkeypatch.setattr(retention, "LEAP", 10**9)
    store = fleet.store(fleet.leases.acquire("shard-1", "node-1", LONG))
    other = fleet.store(fleet.leases.acquire("shard-2", "node-2", LONG))
    old, month = make_sample(0).time, 31 * 86_400

    async def fill() -> None:
        await store.claim("z", "f")
        await other.claim("late", "f")
        for when in (old, old + 3 * month):
            await store.append("z", make_sample(0)._replace(time=when))
        await asyncio.to_thread(store.checkpoints.save, "z", _checkpoint(old + 3 * month))

    asyncio.run(fill())
    writing, told = threading.Event(), threading.Event()

    def work(cursor: Any) -> None:
        number = other._fence.required(cursor, ["late"])["late"]
        cursor.execute(
            "INSERT INTO samples (zone, time, outputs, inputs, output_quality, input_quality, link) "
            "VALUES (%s, %s, '', '', '', '', 0)",
            (number, old),
        )
        writing.set()
        assert told.wait(180)

    def drop() -> None:
        # It may also have found no time at which nobody was writing.
        with suppress(JournalError):
            list(store._prune(Limits(1.5 * month, 1e12)))

    writer, dropper = threading.Thread(target=lambda: other._database.transaction(work)), threading.Thread(target=drop)
    writer.start()
    assert writing.wait(180)
    dropper.start()
    wait_until(lambda: fleet.sql("SELECT 1 FROM pg_stat_activity WHERE wait_event_type = 'Lock'"))
    told.set()
    writer.join()
    dropper.join()
    assert month_of("samples", old).name in _months(fleet)
    assert asyncio.run(other.run(other.journal.last_sample_time, "late")) == old


def _months(fleet: Fleet) -> list[str]:
    rows = fleet.sql(
        "SELECT child.relname FROM pg_inherits JOIN pg_class AS child ON child.oid = inhrelid "
        "WHERE child.relkind = 'r' AND child.relnamespace = '{}'::regnamespace ORDER BY 1"
    )
    return [name for (name,) in rows]


async def test_what_was_set_aside_goes_first_when_there_is_too_much(fleet: Fleet) -> None:
    store = fleet.store(fleet.leases.acquire("shard", "node-1", LONG))
    await store.take(["z", "other"])
    await store.claim("z", "f")
    await store.append("z", make_sample(0))
    await store.forget("z")
    await store.claim("z", "f")
    await store.append("z", make_sample(5))
    before = await store.run(store._own.size)
    await asyncio.to_thread(store.checkpoints.save, "other", Checkpoint("f", 1, {"x": np.arange(100_000.0)}, {}))
    assert 0 < before == await store.run(store._own.size), "checkpoints are no part of the journal"
    await store.run(lambda: list(store._prune(Limits(1e9, 1e12))))
    assert fleet.sql("SELECT count(*) FROM {}.samples") == [(2,)]
    await store.run(lambda: list(store._prune(Limits(1e9, 1.0))))
    assert len(await store.samples_after("z", None)) == 1, "a zone without checkpoints needs every sample"
    assert fleet.sql("SELECT count(*) FROM {}.samples") == [(1,)]
    assert fleet.sql("SELECT zone FROM {}.zones ORDER BY zone") == [("other",), ("z",)]


def test_a_zone_is_reset_as_the_operations_page_tells(fleet: Fleet) -> None:
    """`thermogate run --reset` would start a daemon beside the fleet, and reset nothing."""
    page = (Path(__file__).parents[3] / "docs" / "operations.md").read_text(encoding="utf-8")
    (statement,) = re.findall(r"^UPDATE .*;$", page, re.MULTILINE)

    async def learn() -> None:
        store = fleet.store(fleet.leases.acquire("shard", "node-1", LONG))
        await store.claim("living", "f")
        await store.append("living", make_sample(0))
        await asyncio.to_thread(store.checkpoints.save, "living", _checkpoint(make_sample(0).time))
        for ask in (store.claim("living", "g"), asyncio.to_thread(store.checkpoints.load, "living", "g")):
            with pytest.raises(StateMismatch, match=r"give that state up as docs/operations.md tells .* by SQL"):
                await ask

    async def begin_anew() -> None:
        store = fleet.store(fleet.leases.acquire("shard", "node-1", LONG))
        await store.claim("living", "g")
        assert await asyncio.to_thread(store.checkpoints.load, "living", "g") is None
        assert await store.run(store.journal.last_sample_time, "living") is None
        assert await store.append("living", make_sample(0)) is None

    asyncio.run(learn())
    fleet.sql(statement.replace("thermogate_campus", "{}"))
    asyncio.run(begin_anew())
    assert fleet.sql("SELECT count(*) FROM {}.samples") == [(2,)], "nothing is deleted"
