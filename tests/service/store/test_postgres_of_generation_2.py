"""A database that the second generation wrote goes on: its samples, its history and its checkpoint.

`postgres-of-generation-2.sql` is what pg_dump made of the site `campus` of commit 0c0203e: 20 samples of the zone
`living` with their history, and its checkpoint after the fifteenth.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
from support.fake_zones import make_sample
from support.postgres import server

from service.store.postgres.leases import Leases
from service.store.postgres.store import PostgresStore

DUMP = Path(__file__).with_name("postgres-of-generation-2.sql")


def test_a_database_of_the_second_generation_goes_on() -> None:
    async def go_on(store: PostgresStore) -> None:
        await store.claim("living", "mark")
        found = await asyncio.to_thread(store.checkpoints.load, "living", "mark")
        assert found is not None
        assert (found.step, found.arrays["x"].tolist()) == (make_sample(14).time, [0.0, 1.0, 2.0])
        assert await store.resume_after("living", found.step) == make_sample(19).time
        await store.append("living", make_sample(20))
        after = await store.samples_after("living", found.step)
        assert [sample.time for sample in after] == [make_sample(k).time for k in range(15, 21)]
        np.testing.assert_equal(after[0].outputs, make_sample(15).outputs)
        rows = await store.run(store.journal.history, "living", None, None, 100)
        assert [row.time for row in rows] == [make_sample(k).time for k in range(20)]

    with server() as database:
        database.run(DUMP.read_text(encoding="utf-8"))
        leases = Leases(database.connection, "campus")
        store = PostgresStore(database.connection, "campus", leases.acquire("shard-0", "process 8", 600.0))
        try:
            asyncio.run(go_on(store))
        finally:
            store.close()
            leases.close()
