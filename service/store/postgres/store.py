"""The store of one shard: its zones' part of the database, written to under its lease."""

from service.records.measures import Measure, single
from service.store.journal import Journal
from service.store.journalling import JournalStore
from service.store.postgres.checkpoints import PostgresCheckpoints
from service.store.postgres.leases import Lease, LeasedDatabase
from service.store.postgres.schema import prepare, warn_of_unsafe_commits


class PostgresStore(JournalStore):
    """Journal and checkpoints of `site` in the database that `connection` names. What writes to a zone that is not, or
    no longer, claimed under `lease` raises Fenced."""

    prune_seconds = 300.0
    look_seconds = 5.0
    _too_large = "shorten keep_history, and let the server give the space back with VACUUM FULL, or raise max_journal"

    def __init__(self, connection: str, site: str, lease: Lease) -> None:
        """Opens it, and creates the tables. Raises ServiceError with the remedy where that fails."""
        self.database = LeasedDatabase(connection, site, lease)
        try:
            prepare(self.database)
            warn_of_unsafe_commits(self.database)
        except BaseException:
            self.database.close()
            raise
        self._beside = LeasedDatabase(connection, site, lease)
        super().__init__(Journal(self.database), PostgresCheckpoints(self._beside), self.database.place)

    async def give_up(self, zone: str) -> None:
        """Leave `zone` to the next owner that claims it, with everything that was recorded durable; stop it before."""
        await self.run(self.journal.give_up, zone)

    def problems(self) -> list[str]:
        lost = self.database.lost or self._beside.lost
        return [*super().problems(), *([] if lost is None else [lost])]

    def measures(self) -> list[Measure]:
        text = "Size of samples, history and readings of the site"
        return [Measure("thermogate_journal_bytes", "gauge", text, (), lambda: single(float(self.known_size)))]
