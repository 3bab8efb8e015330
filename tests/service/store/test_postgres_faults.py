"""A database that goes away, stands still, is full or may not be written to: nothing lost, nothing doubled, and it goes
on afterwards."""

import asyncio
import itertools
import logging
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_zones import make_sample, make_update
from support.postgres import Cutting, Server, server
from support.running_zone import Announced, fed, finished, make, plumbing, straight
from support.shards import LONG, READING, WRITING, Shards, checkpoint
from support.waiting import PATIENCE, until
from support.zone_samples import comparable, sample

import service.store.postgres.database as database
from service.errors import JournalError, ServiceError
from service.records.sample import Sample
from service.store.postgres.leases import Lease, Leases
from service.store.postgres.reading import read_site
from service.store.postgres.store import PostgresStore
from service.zone.recovery import is_of_the_environment

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def breakable() -> Iterator[Server]:
    """A server with every commit on the disk, which can be made full."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    with server(fsync=True) as running:
        if compiler is not None:
            library, mark = running.folder / "full_disk.so", running.folder / "full"
            flags = ["-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC", "-o", str(library)]
            subprocess.run([compiler, *flags, str(ROOT / "tests" / "faults" / "full_disk.c"), "-ldl"], check=True)
            running.stop()
            running.environment = {"LD_PRELOAD": str(library), "FULL_DISK": str(mark)}
            running.start()
        yield running


@pytest.fixture
def fragile(breakable: Server) -> Iterator[Shards]:
    """A site on a server that a test stops, fills and makes read-only."""
    if not breakable.is_running():
        breakable.start()
    made = Shards(breakable)
    yield made
    made.close()


async def owner(shards: Shards, connection: str | None = None) -> PostgresStore:
    """A store with the zone "z"."""
    store = shards.store(connection=connection)
    await store.claim("z", "f")
    return store


async def in_the_end(attempt: Callable[[], Awaitable[None]]) -> None:
    """Try until it is done, as an intake does."""
    async with asyncio.timeout(PATIENCE):
        while True:
            try:
                await attempt()
                return
            except Exception as error:
                if not is_of_the_environment(error):
                    raise
                await asyncio.sleep(0.05)


async def every_sample(store: PostgresStore, zone: str) -> list[Sample]:
    found: list[Sample] = []
    while page := await store.samples_after(zone, found[-1].time if found else None):
        found += page
    return found


async def test_nothing_is_lost_or_doubled_when_the_server_is_restarted(
    fragile: Shards, caplog: pytest.LogCaptureFixture
) -> None:
    zones = [f"z{n}" for n in range(20)]
    written: dict[str, int] = dict.fromkeys(zones, -1)
    ended = asyncio.Event()
    store = fragile.store()

    async def feed(zone: str) -> None:
        for step in itertools.count():
            if ended.is_set():
                return
            store.record(zone, make_update(step))
            await in_the_end(lambda step=step: store.append(zone, make_sample(step, 20 + step / 7)))
            written[zone] = step

    for zone in zones:
        await store.claim(zone, "f")
    feeds = [asyncio.create_task(feed(zone)) for zone in zones]
    for sign in (signal.SIGINT, signal.SIGQUIT, None):
        before = min(written.values())
        await until(lambda before=before: min(written.values()) >= before + 3)
        if sign is not None:
            await asyncio.to_thread(fragile.server.stop, sign)
            await asyncio.to_thread(fragile.server.start)
    ended.set()
    await asyncio.gather(*feeds)
    assert store.problems() == []
    for zone in zones:
        samples, count = await every_sample(store, zone), written[zone] + 1
        assert [item.time for item in samples] == [make_sample(step).time for step in range(count)]
        assert [item.outputs[0] for item in samples] == [20 + step / 7 for step in range(count)]
        assert len(await store.run(store.journal.history, zone, None, None, 100_000)) == count
    assert "failed (" in caplog.text, "the restarts came in between"


@pytest.fixture
def cutting(postgres_server: Server) -> Iterator[Cutting]:
    folder = Path(tempfile.mkdtemp(prefix="thermogate-cut-", dir="/tmp"))
    relay = Cutting(folder, postgres_server)
    yield relay
    relay.close()
    shutil.rmtree(folder)


FIRST, SECOND = make_sample(0).time, make_sample(1).time
LEFT: dict[str, list[Any]] = {
    "append": [[FIRST, SECOND], [], None, 1],
    "keep": [[FIRST], [READING], None, 1],
    "skip": [[], [], None, 1],
    "save": [[FIRST], [], 7, 1],
    "set back": [[], [], None, 0],
    "forget": [[], [], None, 0],
    "give up": [[FIRST], [], None, 1],
    "record": [[FIRST], [], None, 2],
}
"""The samples, readings and checkpoint, and how many rows of history, there are after each act."""


@pytest.mark.parametrize("act", LEFT)
@pytest.mark.parametrize("word", [b"COMMIT", b"zone"])
async def test_what_a_cut_connection_left_open_is_done_once(
    act: str, word: bytes, shards: Shards, cutting: Cutting, caplog: pytest.LogCaptureFixture
) -> None:
    """The server has committed, or has not, and the answer never comes: the caller need not know."""
    with caplog.at_level(logging.INFO):
        store = await owner(shards, cutting.connection)
        store.record("z", make_update(0))
        await store.append("z", make_sample(0))
        cutting.word = word
        await WRITING[act](store)
        assert cutting.cuts == 1
        samples = [item.time for item in await store.samples_after("z", None)]
        saved = store.checkpoints.load("z", "f")
        rows = len(await store.run(store.journal.history, "z", None, None, 9))
        kept = await store.run(store.journal.kept, "z", 0.0)
        store.close()
    assert [samples, kept, saved and saved.step, rows] == LEFT[act]
    assert "works again" in caplog.text


def test_a_lease_is_had_though_the_answer_was_cut_off(shards: Shards, cutting: Cutting) -> None:
    leases = Leases(cutting.connection, shards.site)
    cutting.word = b"COMMIT"
    lease = leases.acquire("another", "node", LONG)
    cutting.word = b"COMMIT"
    assert leases.renew(lease, LONG).is_safe()
    assert cutting.cuts == 2
    leases.close()


async def test_while_the_server_is_away_it_is_asked_at_growing_pauses(
    fragile: Shards, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import psycopg

    attempts = 0
    real = psycopg.connect

    def connect(*arguments: Any, **named: Any) -> Any:
        nonlocal attempts
        attempts += 1
        return real(*arguments, **named)

    began = time.monotonic()
    with caplog.at_level(logging.INFO):
        store = await owner(fragile)
        await asyncio.to_thread(fragile.server.stop)
        monkeypatch.setattr(psycopg, "connect", connect)
        for _ in range(200):
            with pytest.raises(JournalError, match=r"the database postgres on .* failed \(.*\); (start|wait until) it"):
                await store.append("z", make_sample(0))
        assert len(store.problems()) == 1
        with pytest.raises(ServiceError, match=r"\); start it"):
            PostgresStore(fragile.connection, fragile.site, Lease("shard", "node", 1, 0.0))
        monkeypatch.undo()
        await asyncio.to_thread(fragile.server.start)
        await in_the_end(lambda: store.append("z", make_sample(0)))
        assert store.problems() == []
    assert attempts <= 4 + (time.monotonic() - began) / database.FIRST_PAUSE
    assert attempts < 100
    assert caplog.text.count("works again") == 1


async def test_a_server_that_may_only_be_read_is_read(fragile: Shards) -> None:
    store, run = await owner(fragile), fragile.server.run
    store.record("z", make_update(0))
    await store.append("z", make_sample(0))
    run("ALTER SYSTEM SET default_transaction_read_only = on", "SELECT pg_reload_conf()")
    await until(lambda: run("SHOW default_transaction_read_only") == [("on",)])
    try:
        session = store.database.read("SELECT pg_backend_pid()")
        with pytest.raises(JournalError, match=r"read-only transaction.*it is a standby or was made read-only"):
            await store.append("z", make_sample(1))
        assert store.database.read("SELECT pg_backend_pid()") != session, "it may find another primary"
        store.record("z", make_update(1))
        assert len(await store.samples_after("z", None)) == 1
        rows = len(await store.run(store.journal.history, "z", None, None, 9))
        assert rows == 1, "what cannot be written yet is not read either"
    finally:
        run("SET default_transaction_read_only = off", "ALTER SYSTEM RESET default_transaction_read_only")
        run("SELECT pg_reload_conf()")
        await until(lambda: run("SHOW default_transaction_read_only") == [("off",)])
    await in_the_end(lambda: store.append("z", make_sample(1)))
    assert len(await store.samples_after("z", None)) == 2
    assert len(await store.run(store.journal.history, "z", None, None, 9)) == 2


async def test_on_a_full_disk_nothing_is_accepted_until_there_is_space(fragile: Shards) -> None:
    if not fragile.server.environment:
        pytest.skip("there is no C compiler")
    mark = fragile.server.folder / "full"
    wide = make_sample(1)._replace(inputs=np.random.default_rng(1).standard_normal(100_000))
    large = checkpoint(7)._replace(arrays={"x": wide.inputs})
    store = await owner(fragile)
    await store.append("z", make_sample(0))
    mark.touch()
    try:
        for _ in range(2):
            with pytest.raises(JournalError, match=r"No space left on device.*free space on the disk of the server"):
                await store.append("z", wide)
        with pytest.raises(JournalError, match="free space on the disk of the server"):
            store.checkpoints.save("z", large)
        assert [item.time for item in await store.samples_after("z", None)] == [make_sample(0).time]
        assert store.checkpoints.load("z", "f") is None
    finally:
        mark.unlink()
    await store.append("z", wide)
    store.checkpoints.save("z", large)
    (found,) = await store.samples_after("z", make_sample(0).time)
    assert found.inputs.tobytes() == wide.inputs.tobytes()


async def test_a_statement_that_takes_too_long_is_given_up(shards: Shards, monkeypatch: pytest.MonkeyPatch) -> None:
    import psycopg

    store = await owner(shards)
    await store.append("z", make_sample(0))
    monkeypatch.setattr(database, "STATEMENT_SECONDS", 0.5)
    shards.server.disconnect()
    with psycopg.connect(shards.connection) as other:
        other.execute(f"LOCK TABLE {shards.schema}.samples IN ACCESS EXCLUSIVE MODE".encode())
        with pytest.raises(JournalError, match=r"statement timeout.*took longer than statement_timeout"):
            await store.append("z", make_sample(1))
    monkeypatch.undo()
    shards.server.disconnect()
    await in_the_end(lambda: store.append("z", make_sample(1)))
    assert len(await store.samples_after("z", None)) == 2


def test_tables_of_another_version_are_refused(shards: Shards) -> None:
    assert shards.sql("SELECT version FROM {}.migrations") == [(2,)]
    for version, says in {
        1: "has schema 1 of an unreleased Thermogate, which this one does not read; use another database",
        99: r"has schema 99 of a newer Thermogate \(this one reads 2\); upgrade Thermogate",
    }.items():
        shards.sql(f"UPDATE {{}}.migrations SET version = {version}")
        for opened in (Leases, lambda *where: PostgresStore(*where, Lease("shard", "node", 1, 0.0))):
            with pytest.raises(JournalError, match=says):
                opened(shards.connection, shards.site)
        with pytest.raises(JournalError, match=says), read_site(shards.connection, shards.site):
            pass


def test_a_wrong_connection_is_told_in_one_sentence_without_the_password(postgres_server: Server) -> None:
    folder = postgres_server.folder
    for connection, says in {
        "hostt=nowhere password=geheim": r"is not understood \(.*hostt.*\); write it as",
        f"host={folder} user=postgres dbname=nothing password=geheim": r'"nothing" does not exist\); .*dbname',
        f"host={folder} user=nobody dbname=postgres password=geheim": r'"nobody" does not exist\); .*user',
        "host=/nonexistent dbname=postgres password=geheim": r"No such file .*; start it, see why",
    }.items():
        with pytest.raises(JournalError) as refused:
            PostgresStore(connection, "site", Lease("shard", "node", 1, 0.0))
        said = str(refused.value)
        assert re.search(says, said)
        assert "geheim" not in said
        assert "\n" not in said


def test_without_psycopg_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(JournalError, match=r"PostgreSQL needs psycopg .*pip install 'thermogate\[fleet\]'"):
        PostgresStore("dbname=postgres", "site", Lease("shard", "node", 1, 0.0))


def test_a_dump_is_a_backup(shards: Shards, tmp_path: Path) -> None:
    """As docs/operations.md has it: dumped while it is written to, restored elsewhere, gone on from."""
    items = [sample(k) for k in range(40)]
    command = shards.server.command
    dump = shards.server.folder / f"{shards.site}.dump"
    copy = f"restored_{shards.site.replace('-', '_')}"

    async def write() -> None:
        async with plumbing(tmp_path, None, 1e-9, shards.store()) as shared:
            zone = make(shared)
            running = await fed(zone, items[:15])
            await zone.settled()
            words = ("--format=custom", f"--schema=thermogate_{shards.site}", f"--file={dump}", "postgres")
            await asyncio.gather(asyncio.to_thread(command, "pg_dump", *words), zone.intake.accept(items[15:30]))
            await finished(zone, running)

    asyncio.run(write())
    command("createdb", copy)
    command("pg_restore", "--exit-on-error", f"--dbname={copy}", str(dump))
    restored = shards.connection.replace("dbname=postgres", f"dbname={copy}")
    leases = Leases(restored, shards.site)

    async def go_on() -> tuple[list[str], int]:
        announcer = Announced()
        store = PostgresStore(restored, shards.site, leases.acquire("shard", "node", LONG))
        async with plumbing(tmp_path, announcer, store=store) as shared:
            zone = make(shared)
            await finished(zone, await fed(zone, items))
            rows = len(await store.run(store.journal.history, "z", None, None, 100))
        return [comparable(update) for _, update in announcer.updates], rows

    announced, rows = asyncio.run(go_on())
    leases.close()
    assert announced == straight(items)[-len(announced) :]
    assert len(announced) <= 26, "it went on from the dump and did not begin anew"
    assert rows == 40
