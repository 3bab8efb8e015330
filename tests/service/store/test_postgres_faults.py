"""A database that goes away, stands still, is full or may not be written to: nothing lost, nothing doubled, and it goes
on afterwards."""

from __future__ import annotations

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
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_zones import make_sample, make_update
from support.postgres import Cutting, Server, server
from support.running_zone import Announced, fed, finished, make, plumbing, straight
from support.waiting import PATIENCE, until
from support.zone_samples import comparable, sample

import service.store.postgres.database as database
from adapters.reading import Reading
from service.errors import JournalError, ServiceError
from service.records.sample import Sample
from service.store.checkpoint import Checkpoint
from service.store.postgres.leases import Lease, Leases
from service.store.postgres.reading import read_site
from service.store.postgres.store import PostgresStore
from service.zone.recovery import is_of_the_environment

ROOT = Path(__file__).parents[3]
LONG = 600.0
_sites = itertools.count()

Use = Callable[[PostgresStore], Awaitable[Any]]


@pytest.fixture
def fragile(breakable: Server) -> Server:
    """A server that a test stops, fills and makes read-only."""
    if not breakable.is_running():
        breakable.start()
    return breakable


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


class Shard:
    """A lease of a site of its own, and a store under it."""

    def __init__(self, connection: str) -> None:
        self.connection, self.site = connection, f"fault-{next(_sites)}"
        self.leases = Leases(connection, self.site)
        self.lease = self.leases.acquire("shard", "node", LONG)

    @asynccontextmanager
    async def opened(self, connection: str | None = None) -> AsyncIterator[PostgresStore]:
        """A store with the zone "z", open."""
        store = PostgresStore(connection or self.connection, self.site, self.lease)
        try:
            await store.claim("z", "f")
            yield store
        finally:
            store.close()

    def schema(self) -> str:
        return f'"thermogate_{self.site}"'


@pytest.fixture
def shard(postgres_server: Server) -> Iterator[Shard]:
    made = Shard(postgres_server.connection)
    yield made
    made.leases.close()


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


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGQUIT])
async def test_nothing_is_lost_or_doubled_when_the_server_is_restarted(
    fragile: Server, sign: signal.Signals, caplog: pytest.LogCaptureFixture
) -> None:
    shard = Shard(fragile.connection)
    zones = [f"z{n}" for n in range(20)]

    written: dict[str, int] = dict.fromkeys(zones, -1)
    ended = asyncio.Event()

    async def feed(zone: str) -> None:
        for step in itertools.count():
            if ended.is_set():
                return
            store.record(zone, make_update(step))
            await in_the_end(lambda step=step: store.append(zone, make_sample(step, 20 + step / 7)))
            written[zone] = step

    async with shard.opened() as store:
        for zone in zones:
            await store.claim(zone, "f")
        feeds = [asyncio.create_task(feed(zone)) for zone in zones]
        for _ in range(2):
            before = min(written.values())
            await until(lambda before=before: min(written.values()) >= before + 3)
            await asyncio.to_thread(fragile.stop, sign)
            await asyncio.to_thread(fragile.start)
        before = min(written.values())
        await until(lambda: min(written.values()) >= before + 3)
        ended.set()
        await asyncio.gather(*feeds)
        assert store.problems() == []
        for zone in zones:
            samples, count = await every_sample(store, zone), written[zone] + 1
            assert [item.time for item in samples] == [make_sample(step).time for step in range(count)]
            assert [item.outputs[0] for item in samples] == [20 + step / 7 for step in range(count)]
            assert len(await store.run(store.journal.history, zone, None, None, 100_000)) == count
    shard.leases.close()
    assert "failed (" in caplog.text, "the restarts came in between"


async def _append(store: PostgresStore) -> None:
    store.record("z", make_update(1))
    await store.append("z", make_sample(1))


async def _keep(store: PostgresStore) -> None:
    await store.write(store.journal.keep, "z", [Reading("z/T_i", 100.0, 20.0)])


async def _skip(store: PostgresStore) -> None:
    await store.write(store.journal.skip, "z", make_sample(0).time, "broken")


async def _save(store: PostgresStore) -> None:
    await asyncio.to_thread(store.checkpoints.save, "z", Checkpoint("f", 7, {"x": np.arange(3.0)}, {}))


async def _set_back(store: PostgresStore) -> None:
    await store.set_back("z", None, None, make_sample(0).time - 1)


async def _forget(store: PostgresStore) -> None:
    await store.forget("z")


async def _give_up(store: PostgresStore) -> None:
    await store.give_up("z")
    await store.claim("z", "f")


@pytest.fixture
def cutting(postgres_server: Server) -> Iterator[Cutting]:
    folder = Path(tempfile.mkdtemp(prefix="thermogate-cut-", dir="/tmp"))
    relay = Cutting(folder, postgres_server)
    yield relay
    relay.close()
    shutil.rmtree(folder)


@pytest.mark.parametrize("act", [_append, _keep, _skip, _save, _set_back, _forget, _give_up])
@pytest.mark.parametrize("word", [b"COMMIT", b"zone"])
async def test_what_a_cut_connection_left_open_is_done_once(
    act: Use, word: bytes, shard: Shard, cutting: Cutting, caplog: pytest.LogCaptureFixture
) -> None:
    """The server has committed, or has not, and the answer never comes: the caller need not know."""

    with caplog.at_level(logging.INFO):
        async with shard.opened(cutting.connection) as store:
            store.record("z", make_update(0))
            await store.append("z", make_sample(0))
            cutting.word = word
            await act(store)
            assert cutting.cuts == 1
            found: list[Any] = [
                [item.time for item in await store.samples_after("z", None)],
                await store.run(store.journal.kept, "z", 0.0),
            ]
            saved = store.checkpoints.load("z", "f")
            found += [len(await store.run(store.journal.history, "z", None, None, 9)), saved and saved.step]
    first, second = make_sample(0).time, make_sample(1).time
    assert (
        found
        == {
            _append: [[first, second], [], 2, None],
            _keep: [[first], [Reading("z/T_i", 100.0, 20.0)], 1, None],
            _skip: [[], [], 1, None],
            _save: [[first], [], 1, 7],
            _set_back: [[], [], 0, None],
            _forget: [[], [], 0, None],
            _give_up: [[first], [], 1, None],
        }[act]
    )
    assert "works again" in caplog.text


def test_a_lease_is_had_though_the_answer_was_cut_off(shard: Shard, cutting: Cutting) -> None:
    leases = Leases(cutting.connection, shard.site)
    cutting.word = b"COMMIT"
    lease = leases.acquire("another", "node", LONG)
    cutting.word = b"COMMIT"
    assert leases.renew(lease, LONG).is_safe()
    assert cutting.cuts == 2
    leases.close()


async def test_while_the_server_is_away_it_is_asked_at_growing_pauses(
    fragile: Server, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import psycopg

    shard = Shard(fragile.connection)
    attempts = 0
    real = psycopg.connect

    def connect(*arguments: Any, **named: Any) -> Any:
        nonlocal attempts
        attempts += 1
        return real(*arguments, **named)

    began = time.monotonic()
    with caplog.at_level(logging.INFO):
        async with shard.opened() as store:
            await asyncio.to_thread(fragile.stop)
            monkeypatch.setattr(psycopg, "connect", connect)
            for _ in range(200):
                with pytest.raises(
                    JournalError, match=r"the database postgres on .* failed \(.*\); (start|wait until) it"
                ):
                    await store.append("z", make_sample(0))
            assert len(store.problems()) == 1
            with pytest.raises(ServiceError, match=r"\); start it"):
                PostgresStore(shard.connection, shard.site, shard.lease)
            monkeypatch.undo()
            await asyncio.to_thread(fragile.start)
            await in_the_end(lambda: store.append("z", make_sample(0)))
            assert store.problems() == []
    shard.leases.close()
    assert attempts <= 4 + (time.monotonic() - began) / database.FIRST_PAUSE
    assert attempts < 100
    assert caplog.text.count("works again") == 1


async def test_a_server_that_may_only_be_read_is_read(fragile: Server) -> None:
    shard = Shard(fragile.connection)

    async with shard.opened() as store:
        store.record("z", make_update(0))
        await store.append("z", make_sample(0))
        fragile.run("ALTER SYSTEM SET default_transaction_read_only = on", "SELECT pg_reload_conf()")
        await until(lambda: fragile.run("SHOW default_transaction_read_only") == [("on",)])
        try:
            session = store._database.read("SELECT pg_backend_pid()")
            with pytest.raises(JournalError, match=r"read-only transaction.*it is a standby or was made read-only"):
                await store.append("z", make_sample(1))
            assert store._database.read("SELECT pg_backend_pid()") != session, "it may find another primary"
            store.record("z", make_update(1))
            assert len(await store.samples_after("z", None)) == 1
            assert len(await store.run(store.journal.history, "z", None, None, 9)) == 1, (
                "what cannot be written yet is not read either"
            )
        finally:
            fragile.run(
                "SET default_transaction_read_only = off",
                "ALTER SYSTEM RESET default_transaction_read_only",
            )
            fragile.run("SELECT pg_reload_conf()")
            await until(lambda: fragile.run("SHOW default_transaction_read_only") == [("off",)])
        await in_the_end(lambda: store.append("z", make_sample(1)))
        assert len(await store.samples_after("z", None)) == 2
        assert len(await store.run(store.journal.history, "z", None, None, 9)) == 2
    shard.leases.close()


async def test_on_a_full_disk_nothing_is_accepted_until_there_is_space(fragile: Server) -> None:
    if not fragile.environment:
        pytest.skip("there is no C compiler")
    shard = Shard(fragile.connection)
    mark = fragile.folder / "full"
    wide = make_sample(1)._replace(inputs=np.random.default_rng(1).standard_normal(100_000))

    async with shard.opened() as store:
        await store.append("z", make_sample(0))
        mark.touch()
        try:
            for _ in range(2):
                with pytest.raises(
                    JournalError, match=r"No space left on device.*free space on the disk of the server"
                ):
                    await store.append("z", wide)
            with pytest.raises(JournalError, match="free space on the disk of the server"):
                store.checkpoints.save("z", Checkpoint("f", 7, {"x": wide.inputs}, {}))
            assert [item.time for item in await store.samples_after("z", None)] == [make_sample(0).time]
            assert store.checkpoints.load("z", "f") is None
        finally:
            mark.unlink()
        await store.append("z", wide)
        store.checkpoints.save("z", Checkpoint("f", 7, {"x": wide.inputs}, {}))
        (found,) = await store.samples_after("z", make_sample(0).time)
        assert found.inputs.tobytes() == wide.inputs.tobytes()
    shard.leases.close()


async def test_a_statement_that_takes_too_long_is_given_up(
    shard: Shard, postgres_server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    import psycopg

    async with shard.opened() as store:
        await store.append("z", make_sample(0))
        monkeypatch.setattr(database, "STATEMENT_SECONDS", 0.5)
        postgres_server.disconnect()
        with psycopg.connect(postgres_server.connection) as other:
            other.execute(f"LOCK TABLE {shard.schema()}.samples IN ACCESS EXCLUSIVE MODE".encode())
            with pytest.raises(JournalError, match=r"statement timeout.*took longer than statement_timeout"):
                await store.append("z", make_sample(1))
        monkeypatch.undo()
        postgres_server.disconnect()
        await in_the_end(lambda: store.append("z", make_sample(1)))
        assert len(await store.samples_after("z", None)) == 2


def test_tables_of_another_version_are_refused(shard: Shard, postgres_server: Server) -> None:
    assert postgres_server.run(f"SELECT version FROM {shard.schema()}.migrations") == [(2,)]
    for version, says in {
        1: "has version 1 of an unreleased Thermogate, which this one does not read; drop the schema to begin anew",
        99: r"has version 99 of a newer Thermogate \(this one reads 2\); upgrade Thermogate",
    }.items():
        postgres_server.run(f"UPDATE {shard.schema()}.migrations SET version = {version}")
        for opened in (Leases, lambda *where: PostgresStore(*where, shard.lease)):
            with pytest.raises(JournalError, match=says):
                opened(shard.connection, shard.site)
        with pytest.raises(JournalError, match=says), read_site(shard.connection, shard.site):
            pass


def test_a_wrong_connection_is_told_in_one_sentence_without_the_password(postgres_server: Server) -> None:
    lease = Lease("shard", "node", 1, 0.0)
    server = postgres_server.folder
    for connection, says in {
        "hostt=nowhere password=geheim": r"is not understood \(.*hostt.*\); write it as",
        f"host={server} user=postgres dbname=nothing password=geheim": r'"nothing" does not exist\); .*dbname',
        f"host={server} user=nobody dbname=postgres password=geheim": r'"nobody" does not exist\); .*user',
        "host=/nonexistent dbname=postgres password=geheim": r"No such file .*; start it, see why",
    }.items():
        with pytest.raises(JournalError) as refused:
            PostgresStore(connection, "site", lease)
        said = str(refused.value)
        assert re.search(says, said)
        assert "geheim" not in said
        assert "\n" not in said


def test_without_psycopg_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(JournalError, match=r"PostgreSQL needs psycopg .*pip install 'thermogate\[fleet\]'"):
        PostgresStore("dbname=postgres", "site", Lease("shard", "node", 1, 0.0))


def test_a_dump_is_a_backup(shard: Shard, postgres_server: Server, tmp_path: Path) -> None:
    """As docs/operations.md has it: dumped while it is written to, restored elsewhere, gone on from."""
    items = [sample(k) for k in range(40)]
    dump = postgres_server.folder / f"{shard.site}.dump"
    copy = f"restored_{shard.site.replace('-', '_')}"

    async def write() -> None:
        store = PostgresStore(shard.connection, shard.site, shard.lease)
        async with plumbing(tmp_path, None, 1e-9, store) as shared:
            zone = make(shared)
            running = await fed(zone, items[:15])
            await zone.settled()
            dumping = asyncio.to_thread(
                postgres_server.command,
                "pg_dump",
                "--format=custom",
                f"--schema=thermogate_{shard.site}",
                f"--file={dump}",
                "postgres",
            )
            await asyncio.gather(dumping, zone.intake.accept(items[15:30]))
            await finished(zone, running)

    asyncio.run(write())
    postgres_server.command("createdb", copy)
    postgres_server.command("pg_restore", "--exit-on-error", f"--dbname={copy}", str(dump))
    restored = shard.connection.replace("dbname=postgres", f"dbname={copy}")
    leases = Leases(restored, shard.site)

    async def go_on() -> tuple[list[str], int]:
        announcer = Announced()
        store = PostgresStore(restored, shard.site, leases.acquire("shard", "node", LONG))
        async with plumbing(tmp_path, announcer, store=store) as shared:
            zone = make(shared)
            running = await fed(zone, items)
            await finished(zone, running)
            rows = len(await store.run(store.journal.history, "z", None, None, 100))
        return [comparable(update) for _, update in announcer.updates], rows

    announced, rows = asyncio.run(go_on())
    leases.close()
    whole = straight(items)
    assert announced == whole[-len(announced) :]
    assert len(announced) <= 26, "it went on from the dump and did not begin anew"
    assert rows == 40
