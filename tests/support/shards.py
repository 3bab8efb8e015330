"""The owners of a site in PostgreSQL, and everything that one of them may write."""

import asyncio
import itertools
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
from support.fake_zones import make_sample, make_update
from support.postgres import Server

from adapters.reading import Reading
from service.store.checkpoint import Checkpoint
from service.store.postgres.leases import Lease, Leases
from service.store.postgres.store import PostgresStore
from service.store.retention import Limits, prune

LONG = 600.0
READING = Reading("z/T_i", make_sample(1).time + 1.0, 20.0)

_sites = itertools.count()


class Shards:
    """The leases of a site of its own, and stores under them."""

    def __init__(self, server: Server) -> None:
        self.server, self.connection = server, server.connection
        self.site = f"shards-{next(_sites)}"
        self.schema = f'"thermogate_{self.site}"'
        self.leases = Leases(server.connection, self.site)
        self._opened: list[PostgresStore] = []

    def store(self, lease: Lease | str = "shard", connection: str | None = None) -> PostgresStore:
        """A store under a lease, or one of this name that the node of this name takes."""
        if isinstance(lease, str):
            lease = self.leases.acquire(lease, lease.replace("shard", "node"), LONG)
        self._opened.append(PostgresStore(connection or self.connection, self.site, lease))
        return self._opened[-1]

    def sql(self, statement: str) -> list[tuple[Any, ...]]:
        """Run a statement with {} for the schema."""
        return self.server.run(statement.format(self.schema))

    def expire(self, lease: Lease) -> None:
        """As if its time were over."""
        self.sql(f"UPDATE {{}}.leases SET expires = clock_timestamp() WHERE name = '{lease.name}'")

    def everything(self) -> list[Any]:
        """All rows of all tables."""
        tables = ("zones", "samples", "history", "readings", "checkpoints", "leases", "forgotten", "pruned")
        return [sorted(map(str, self.sql(f"SELECT * FROM {{}}.{table}"))) for table in tables]

    def close(self) -> None:
        for store in self._opened:
            store.close()
        self.leases.close()


def checkpoint(step: int) -> Checkpoint:
    """A checkpoint of the fingerprint "f"."""
    return Checkpoint("f", step, {"x": np.arange(3.0)}, {})


async def filled(store: PostgresStore) -> None:
    """A sample and a checkpoint of the zone "z", and a row of its history."""
    await store.claim("z", "f")
    store.record("z", make_update(0))
    await store.append("z", make_sample(0))
    await asyncio.to_thread(store.checkpoints.save, "z", checkpoint(1))


async def _recorded(store: PostgresStore) -> None:
    store.record("z", make_update(1))
    await store.run(store.journal.flush)


async def _given_up(store: PostgresStore) -> None:
    await store.give_up("z")
    await store.claim("z", "f")


WRITING: dict[str, Callable[[PostgresStore], Awaitable[Any]]] = {
    "append": lambda store: store.append("z", make_sample(1)),
    "keep": lambda store: store.keep("z", [READING]),
    "skip": lambda store: store.run(store.journal.skip, "z", make_sample(0).time, "broken"),
    "save": lambda store: asyncio.to_thread(store.checkpoints.save, "z", checkpoint(7)),
    "set checkpoints aside": lambda store: asyncio.to_thread(store.checkpoints.set_aside, "z", 0),
    "set back": lambda store: store.set_back("z", None, None, make_sample(0).time - 1),
    "forget": lambda store: store.forget("z"),
    "give up": _given_up,
    "record": _recorded,
    "prune": lambda store: store.run(lambda: list(prune(store.journal, store.checkpoints.oldest, Limits(1.0, 1.0)))),
}
"""Everything that an owner does to its zone."""
