"""A shard whose start fails leaves nothing behind that stands against the next one."""

import os
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support.campus import small_site
from support.postgres import Server

from service.config.load import load
from service.daemon.runtime import Runtime
from service.errors import JournalError, ServiceError
from service.publish.kinds import SINK_KINDS
from service.publish.sinks import Announcement, Sink
from service.store.postgres.leases import Leases
from service.store.postgres.store import PostgresStore

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.fleet.shards import shard as module
from service.fleet.shards.crashes import Crashes
from service.fleet.shards.shard import _Work


class Outlet(Sink):
    """A sink that is open or not."""

    def __init__(self) -> None:
        self.closed = 0

    def publish(self, announcement: Announcement) -> None:
        pass

    def close(self) -> None:
        self.closed += 1


def fail(*arguments: object, **named: object) -> None:
    raise JournalError("the database cannot be written now")


async def fail_later(*arguments: object, **named: object) -> None:
    fail()


STEPS: dict[str, list[tuple[type, str]]] = {
    "the second sink": [],
    "the zones are taken": [(PostgresStore, "claim")],
    "the zones are restored": [(Runtime, "restore")],
    "the zones are stopped as well": [(Runtime, "start_feeds"), (Runtime, "drain")],
}
"""What fails at each step; the sink is no class of its own."""


def own_threads() -> list[str]:
    """The threads of leases and pools."""
    return [thread.name for thread in threading.enumerate() if thread.name.startswith(("lease", "estimator", "asking"))]


@pytest.mark.parametrize("step", STEPS)
async def test_a_start_that_fails_gives_back_its_lease_and_closes_its_sinks(
    step: str, tmp_path: Path, postgres_server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = f"begin-{os.getpid()}-{list(STEPS).index(step)}"
    config = load(small_site(tmp_path, count=2, shards=2, site=site, lease=2.0))
    ended, sinks = [], [Outlet(), Outlet()]
    monkeypatch.setattr(module, "end_process", lambda: ended.append(1))
    monkeypatch.setattr("service.fleet.shards.leasing.connection_of", lambda fleet: postgres_server.connection)
    kinds: list[Any] = [
        SimpleNamespace(name=name, open=lambda table, site, sink=sink: sink)
        for name, sink in zip(("zenoh", "mqtt"), sinks, strict=True)
    ]
    for kind in kinds:
        monkeypatch.setitem(SINK_KINDS, kind.name, kind)
    crashes = Crashes(site, "shard-0", tmp_path)
    try:
        before = own_threads()
        with monkeypatch.context() as patch:
            for place, method in STEPS[step]:
                patch.setattr(place, method, fail_later)
            if not STEPS[step]:
                patch.setattr(kinds[1], "open", fail)
            with pytest.raises(ServiceError, match="cannot be written now"):
                await _Work.begin(site, "shard-0", "owner", config, crashes)
        assert own_threads() == before
        opened = sinks if STEPS[step] else sinks[:1]
        assert [sink.closed for sink in opened] == [1] * len(opened)
        leases = Leases(postgres_server.connection, site)
        try:
            # Nobody else could have it for 2 s.
            leases.release(leases.acquire("shard-0", "another process", 600.0))
        finally:
            leases.close()
        work = await _Work.begin(site, "shard-0", "owner", config, crashes)
        assert work.leased.held
        assert len(work.zones) == 3
        await work.stop()
        assert own_threads() == before
        assert not ended
    finally:
        crashes.close()
