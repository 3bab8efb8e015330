"""Two owners: what was one's is the other's now, and nothing that the first one still sends is written."""

import asyncio
import re
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from support.fake_zones import make_sample, make_update
from support.shards import LONG, WRITING, Shards, checkpoint, filled
from support.waiting import wait_until

import service.store.postgres.database as database
import service.store.postgres.leases as leases_module
from service.errors import Fenced, LeaseHeld, StateMismatch
from service.store.postgres.leases import Lease, Leases
from service.store.postgres.store import PostgresStore


def lasts(lease: Lease, seconds: float) -> bool:
    """Whether nobody else can have it in so many s."""
    return lease._replace(until=lease.until - seconds).is_safe()


def lapsed(shards: Shards) -> tuple[Lease, PostgresStore]:
    """A lease of node-1 that has expired, and its store, which has the zone "z"."""
    lease = shards.leases.acquire("shard", "node-1", LONG)
    store = shards.store(lease)
    asyncio.run(filled(store))
    shards.expire(lease)
    return lease, store


def test_a_lease_has_one_owner_until_it_expires_or_is_released(shards: Shards) -> None:
    first = shards.leases.acquire("shard", "node-1", LONG)
    assert first[:3] == ("shard", "node-1", 1)
    assert lasts(first, LONG - 60)
    assert not lasts(first, LONG + 1)
    with pytest.raises(LeaseHeld, match=r"the lease 'shard' belongs to node-1 for [56]") as held:
        shards.leases.acquire("shard", "node-2", LONG)
    assert LONG - 60 < held.value.seconds <= LONG
    assert shards.leases.acquire("other", "node-2", LONG).epoch == 1
    shards.expire(first)
    second = shards.leases.acquire("shard", "node-2", LONG)
    assert second.epoch == 2
    with pytest.raises(Fenced, match=r"the lease 'shard' of node-1 \(epoch 1\) has gone to another owner"):
        shards.leases.renew(first, LONG)
    shards.leases.release(first)
    assert lasts(shards.leases.renew(second, 2 * LONG), LONG), "an old owner cannot give it away"
    shards.leases.release(second)
    assert shards.leases.acquire("shard", "node-3", LONG).epoch > second.epoch
    again = shards.leases.acquire("shard", "node-3", LONG)
    shards.expire(again)
    assert shards.leases.renew(again, LONG).is_safe(), "nobody has taken it meanwhile"
    assert again.epoch > second.epoch + 1, "the same owner, started again, need not wait; what it was before is fenced"


@pytest.mark.parametrize("skew", [-300.0, 300.0])
def test_clocks_that_are_wrong_do_no_harm(shards: Shards, skew: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nodes whose clocks differ from the database's, and which were started at other times."""
    held = shards.leases.acquire("shard", "node-1", 120.0)
    real, steady = time.time, leases_module.steady
    monkeypatch.setattr(time, "time", lambda: real() + skew)
    monkeypatch.setattr(leases_module, "steady", lambda: steady() + 1e6)
    with pytest.raises(LeaseHeld):
        shards.leases.acquire("shard", "node-2", 120.0)
    other = shards.leases.acquire("other", "node-2", 120.0)
    assert lasts(other, 1.0)
    assert not lasts(other, 121.0)
    monkeypatch.setattr(leases_module, "steady", steady)
    for lease in (held, shards.leases.renew(held, LONG)):
        seconds = "SELECT extract(epoch FROM expires - clock_timestamp())::float8 FROM {}.leases WHERE name = 'shard'"
        ((left,),) = shards.sql(seconds)
        assert lease.until - steady() <= left + 0.001, "never longer than the database has it"
    assert not lasts(held, 121.0)
    assert lasts(lease, 121.0)


@pytest.mark.parametrize(("act", "other"), [*((act, "node-2") for act in WRITING), ("append", "node-1")])
def test_who_has_lost_the_lease_writes_nothing(shards: Shards, act: str, other: str) -> None:
    """Also where the same owner has started again."""
    _, stale = lapsed(shards)
    shards.leases.acquire("shard", other, LONG)
    before = shards.everything()
    with pytest.raises(Fenced, match=r"the lease 'shard' of node-1 \(epoch 1\) has gone to another owner"):
        asyncio.run(WRITING[act](stale))
    assert shards.everything() == before
    assert any("has gone to another owner" in problem for problem in stale.problems())


@pytest.mark.parametrize("act", sorted(WRITING.keys() - {"record", "prune", "forget", "give up"}))
async def test_who_has_lost_a_zone_writes_nothing_to_it(shards: Shards, act: str) -> None:
    stale = shards.store("shard-1")
    other = shards.store("shard-2")
    await filled(stale)
    await stale.give_up("z")
    await other.claim("z", "f")
    before = shards.everything()
    with pytest.raises(Fenced, match=r"zone 'z' is not held by the lease 'shard-1' of node-1"):
        await WRITING[act](stale)
    assert shards.everything() == before
    assert stale.problems() == []


async def test_a_zone_that_another_one_holds_is_neither_taken_nor_reset_nor_pruned(shards: Shards) -> None:
    stale = shards.store("shard-1")
    await filled(shards.store("shard-2"))
    before = shards.everything()
    await stale.give_up("z")
    for attempt in (stale.claim("z", "f"), stale.forget("z")):
        with pytest.raises(Fenced, match=r"zone 'z' belongs to the lease 'shard-2' of node-2 for \d+ s more"):
            await attempt
    stale.record("z", make_update(1))
    await stale.run(stale.journal.flush)
    assert shards.everything() == before


async def test_a_zone_that_has_gone_does_not_take_the_commit_of_the_others_along(shards: Shards) -> None:
    store = shards.store("shard-1")
    other = shards.store("shard-2")
    for zone in "abc":
        await store.claim(zone, "f")
        store.record(zone, make_update(0))
    await store.give_up("b")
    await other.claim("b", "f")
    store.record("b", make_update(1))
    results = await asyncio.gather(*(store.append(zone, make_sample(0)) for zone in "abc"), return_exceptions=True)
    assert [len(await other.run(other.journal.history, zone, None, None, 10)) for zone in "abc"] == [1, 1, 1]
    first, second, third = results
    assert (first, third) == (None, None)
    assert isinstance(second, Fenced)
    assert second.zones == ("b",)
    assert [len(await other.samples_after(zone, None)) for zone in "ab"] == [1, 0]


async def test_the_zones_of_an_owner_that_is_gone_are_taken_one_by_one_and_it_is_fenced(shards: Shards) -> None:
    lease = shards.leases.acquire("shard-1", "node-1", LONG)
    gone, other = shards.store(lease), shards.store("shard-2")
    for zone in "ab":
        await gone.claim(zone, "f")
        await gone.append(zone, make_sample(0))
    shards.expire(lease)
    for zone in ("a", "b", "new"):
        await other.claim(zone, "f")
    await other.append("a", make_sample(1))
    with pytest.raises(Fenced, match="has gone to another owner"):
        await gone.append("b", make_sample(1))
    with pytest.raises(Fenced):
        shards.leases.renew(lease, LONG)
    await other.append("b", make_sample(1))
    assert [len(await other.samples_after(zone, None)) for zone in "ab"] == [2, 2]


def test_a_lease_is_not_taken_in_the_middle_of_a_transaction_and_renewed_meanwhile(shards: Shards) -> None:
    lease, store = lapsed(shards)
    writing, told = threading.Event(), threading.Event()

    def work(cursor: Any) -> None:
        store.database.writable(cursor, ["z"], ())
        writing.set()
        assert told.wait(180)
        cursor.execute("UPDATE samples SET skipped = ?", "late")

    writer = threading.Thread(target=lambda: store.database.transaction(work))
    writer.start()
    assert writing.wait(180)
    assert shards.leases.renew(lease, LONG).is_safe(), "renewing waits for nobody"
    shards.expire(lease)
    taken: list[Lease] = []
    other = Leases(shards.server.connection, shards.site)
    taker = threading.Thread(target=lambda: taken.append(other.acquire("shard", "node-2", LONG)))
    taker.start()
    wait_until(lambda: shards.sql("SELECT 1 FROM pg_stat_activity WHERE wait_event_type = 'Lock'"))
    assert not taken
    told.set()
    writer.join()
    taker.join()
    other.close()
    assert taken[0].epoch == 2
    assert shards.sql("SELECT skipped FROM {}.samples") == [("late",)], "it was written before the lease went"


def test_an_owner_that_froze_in_the_middle_of_a_transaction_keeps_nobody_waiting(
    shards: Shards, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, store = lapsed(shards)
    monkeypatch.setattr(database, "FROZEN_SECONDS", 1.0)
    shards.server.disconnect()
    waited = threading.Event()

    def work(cursor: Any) -> None:
        store.database.writable(cursor, ["z"], ())
        if not waited.is_set():
            assert shards.leases.acquire("shard", "node-2", LONG).epoch == 2
            waited.set()
        cursor.execute("UPDATE samples SET skipped = ?", "stale")

    with pytest.raises(Fenced):
        store.database.transaction(work)
    assert waited.is_set()
    assert shards.sql("SELECT skipped FROM {}.samples") == [(None,)]


def test_a_zone_is_reset_as_the_operations_page_tells(shards: Shards) -> None:
    """`thermogate run --reset` would start a daemon beside the fleet, and reset nothing."""
    page = (Path(__file__).parents[3] / "docs" / "operations.md").read_text(encoding="utf-8")
    (statement,) = re.findall(r"^INSERT INTO .*;$", page, re.MULTILINE)

    async def learn() -> None:
        store = shards.store()
        await store.claim("living", "f")
        await store.append("living", make_sample(0))
        await asyncio.to_thread(store.checkpoints.save, "living", checkpoint(make_sample(0).time))
        for ask in (store.claim("living", "g"), asyncio.to_thread(store.checkpoints.load, "living", "g")):
            with pytest.raises(StateMismatch, match=r"give that state up as docs/operations.md tells .* by SQL"):
                await ask

    async def begin_anew() -> None:
        store = shards.store()
        await store.claim("living", "g")
        assert await asyncio.to_thread(store.checkpoints.load, "living", "g") is None
        assert await store.run(store.journal.last_sample_time, "living") is None
        assert await store.append("living", make_sample(0)) is None

    asyncio.run(learn())
    shards.sql(statement.replace("thermogate_campus", "{}"))
    asyncio.run(begin_anew())
    assert shards.sql("SELECT count(*) FROM {}.samples") == [(2,)], "nothing is deleted"
