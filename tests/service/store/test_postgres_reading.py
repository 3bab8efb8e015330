"""The state of a fleet's site, read beside its owner."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from support.fake_zones import make_sample, make_update
from support.postgres import Server

from service.errors import Fenced, ServiceError
from service.store.checkpoint import Checkpoint
from service.store.postgres.leases import Leases
from service.store.postgres.reading import read_site
from service.store.postgres.store import PostgresStore

_sites = itertools.count()


@pytest.fixture
def site(postgres_server: Server) -> Iterator[str]:
    """A site with a zone of two samples and two checkpoints, the newer one damaged, whose owner is still there."""
    name = f"read-{next(_sites)}"
    leases = Leases(postgres_server.connection, name)
    store = PostgresStore(postgres_server.connection, name, leases.acquire("shard", "owner", 600.0))

    async def fill() -> None:
        await store.claim("z", "mark")
        for step in (0, 1):
            await store.append("z", make_sample(step))
            store.record("z", make_update(step))
            checkpoint = Checkpoint("mark", make_sample(step).time, {"state": np.arange(3.0) + step}, {})
            await asyncio.to_thread(store.checkpoints.save, "z", checkpoint)
        await store.claim("empty", "mark")
        await store.write(store.journal.flush)

    asyncio.run(fill())
    postgres_server.run(
        f"UPDATE \"thermogate_{name}\".checkpoints SET content = '\\x00' WHERE step = {make_sample(1).time}"
    )
    yield name
    store.close()
    leases.close()


def test_it_is_read_as_its_owner_has_written_it(site: str, postgres_server: Server) -> None:
    with read_site(postgres_server.connection, site) as state:
        assert state.zones() == {"z": "mark"}
        assert [sample.time for sample in state.journal.samples_after("z", None)] == [
            make_sample(step).time for step in (0, 1)
        ]
        assert state.journal.samples_ahead("z", make_sample(0).time) == 1
        assert state.journal.last_sample_time("z") == make_sample(1).time
        assert len(state.journal.history("z", None, None, 9)) == 2
        found = state.checkpoint("z", "mark")
        assert found is not None
        assert found.step == make_sample(0).time, "the damaged one is left out"
        assert state.checkpoint("z", "another") is None


def test_nothing_is_written(site: str, postgres_server: Server) -> None:
    with read_site(postgres_server.connection, site) as state, pytest.raises(Fenced):
        state.journal.append_all([("z", make_sample(2))])
    marked = postgres_server.run(f'SELECT count(*) FROM "thermogate_{site}".checkpoints WHERE damaged')
    assert marked == [(0,)]


def test_a_site_that_is_not_there_is_refused_and_not_made(postgres_server: Server) -> None:
    refused = pytest.raises(ServiceError, match="there is no state of the site 'elsewhere'")
    with refused, read_site(postgres_server.connection, "elsewhere"):
        pass
    assert postgres_server.run("SELECT to_regnamespace('thermogate_elsewhere')") == [(None,)]
