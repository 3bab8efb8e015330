"""The store of one shard: its zones' part of the database, written to under its lease."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection
from contextlib import suppress

from service.errors import ServiceError
from service.records.measures import Measure, Rows, single
from service.store.journalling import JournalStore
from service.store.postgres.checkpoints import PostgresCheckpoints
from service.store.postgres.database import Database
from service.store.postgres.fence import Fence
from service.store.postgres.journal import PostgresJournal
from service.store.postgres.leases import Lease
from service.store.postgres.names import RESET
from service.store.postgres.retention import prune
from service.store.postgres.schema import prepare, warn_of_unsafe_commits
from service.store.retention import Limits

PRUNE_SECONDS = 300.0
"""How often the tables are looked through for what their limits no longer allow."""

LOOK_SECONDS = 5.0
"""How often the store looks whether the database is there and the lease is held."""

_BETWEEN_SLICES = 0.02
"""Pause between two slices of pruning, in s: other work of the journal's thread comes first."""

_log = logging.getLogger(__name__)

_DONE = object()


class PostgresStore(JournalStore):
    """Journal and checkpoints of `site` in the database that `connection` names, written to under `lease`.

    `claim` takes a zone for the lease; until then, and after another owner has taken the zone or the lease, everything
    that writes to the zone raises Fenced. A `ZoneStore`, as is the one of SQLite.
    """

    def __init__(self, connection: str, site: str, lease: Lease) -> None:
        """Opens it, and creates or upgrades the tables. Raises ServiceError with the remedy where that fails."""
        self._fence = Fence(lease)
        self._database = Database(connection, site)
        try:
            prepare(self._database)
            warn_of_unsafe_commits(self._database)
        except BaseException:
            self._database.close()
            raise
        self._own = PostgresJournal(self._database, self._fence)
        self._kept = PostgresCheckpoints(Database(connection, site), self._fence)
        self._size = 0
        super().__init__(self._own, self._kept, f"the database {self._database.place}", RESET)

    @property
    def lost(self) -> str | None:
        """Why nothing can be written under this lease ever again; None while it is held, as far as is known."""
        return self._fence.lost

    async def take(self, zones: Collection[str]) -> None:
        """Take many zones at once, as far as nobody else holds them; `claim` of each is quicker then."""
        await self._run(self._own.take, zones)

    async def give_up(self, zone: str) -> None:
        """Leave `zone` to the next owner that claims it, with everything that was recorded durable; stop it before."""
        await self._run(self._own.give_up, zone)

    def problems(self) -> list[str]:
        """What keeps the store from accepting anything; nothing if all is well."""
        return [problem for problem in (self._fence.lost, self._database.trouble) if problem is not None]

    async def watch(self) -> None:
        """Look for ever whether the database is there and the lease is held, and say so in the log when it is not."""
        while True:
            with suppress(ServiceError):
                await self._run(self._own.look)
            await asyncio.sleep(LOOK_SECONDS)

    async def keep_within(self, limits: Limits) -> None:
        """Delete, for ever, what the tables hold beyond `limits`."""
        while True:
            try:
                slices = prune(self._own, limits)
                while await self._run(next, slices, _DONE) is not _DONE:
                    await asyncio.sleep(_BETWEEN_SLICES)
                self._size = await self._run(self._own.size)
                if self._size > limits.max_journal:
                    _log.warning(
                        "the journal of the site takes %d bytes, more than max_journal = %d, and a start may need all "
                        "of it; raise max_journal, or see which zone writes no checkpoints",
                        self._size,
                        limits.max_journal,
                    )
            except ServiceError as error:
                _log.error("the tables cannot be kept within their limits: %s", error)
            await asyncio.sleep(PRUNE_SECONDS)

    def measures(self) -> list[Measure]:
        """What metrics tell of the store."""

        def read() -> Rows:
            return single(float(self._size))

        return [
            Measure("thermogate_journal_bytes", "gauge", "Size of samples, history and readings of the site", (), read)
        ]

    def close(self) -> None:
        """Make durable what was recorded, and close the connections; safe to call twice."""
        try:
            super().close()
        finally:
            self._kept.close()
