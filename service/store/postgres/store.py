"""The store of one shard: its zones' part of the database, written to under its lease."""

from __future__ import annotations

from collections.abc import Collection, Iterator

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


class PostgresStore(JournalStore):
    """Journal and checkpoints of `site` in the database that `connection` names, written to under `lease`.

    `claim` takes a zone for the lease; until then, and after another owner has taken the zone or the lease, everything
    that writes to the zone raises Fenced.
    """

    prune_seconds = 300.0
    look_seconds = 5.0

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
        self._known_size = 0
        super().__init__(self._own, self._kept, f"the database {self._database.place}", RESET)

    async def take(self, zones: Collection[str]) -> None:
        """Take many zones at once, as far as nobody else holds them; `claim` of each is quicker then."""
        await self.run(self._own.take, zones)

    async def give_up(self, zone: str) -> None:
        """Leave `zone` to the next owner that claims it, with everything that was recorded durable; stop it before."""
        await self.run(self._own.give_up, zone)

    def problems(self) -> list[str]:
        """What keeps the store from accepting anything; nothing if all is well."""
        return [problem for problem in (self._fence.lost, self._database.trouble) if problem is not None]

    def _look(self) -> None:
        self._own.look()

    def _prune(self, limits: Limits) -> Iterator[None]:
        return prune(self._own, self._oldest_checkpoint, limits)

    def _size(self) -> int:
        self._known_size = self._own.size()
        return self._known_size

    def measures(self) -> list[Measure]:
        """What metrics tell of the store."""

        def read() -> Rows:
            return single(float(self._known_size))

        return [
            Measure("thermogate_journal_bytes", "gauge", "Size of samples, history and readings of the site", (), read)
        ]

    def close(self) -> None:
        """Make durable what was recorded, and close the connections; safe to call twice."""
        try:
            super().close()
        finally:
            self._kept.close()
