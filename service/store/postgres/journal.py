"""The journal of a shard in PostgreSQL: the same rows, bits and checksums as in SQLite, written under a lease."""

from __future__ import annotations

from collections.abc import Collection

from service.errors import Fenced
from service.store.database import Cursor
from service.store.journal import Journal
from service.store.postgres.database import PostgresDatabase
from service.store.postgres.leases import Fence


class LeasedJournal(Journal):
    """The journal in `database`, written to as far as `fence` lets it: methods that write may raise Fenced."""

    def __init__(self, database: PostgresDatabase, fence: Fence) -> None:
        super().__init__(database)
        self._fence = fence

    def give_up(self, zone: str) -> None:
        """Make durable what was recorded, and leave `zone` to whoever claims it next; nothing if it has gone."""
        lease = self._fence.lease
        query = "UPDATE zones SET lease = NULL WHERE zone = ? AND lease = ? AND epoch = ?"
        self._write((), lambda cursor: cursor.execute(query, zone, lease.name, lease.epoch))
        self._ends.pop(zone, None)
        self._keeping.discard(zone)

    def prunable(self) -> list[str]:
        """The zones of the lease."""
        self.flush()
        lease = self._fence.lease
        query = "SELECT zone FROM zones WHERE lease = ? AND epoch = ? ORDER BY zone"
        return [zone for (zone,) in self.read(query, lease.name, lease.epoch)]

    def close(self) -> None:
        """As every journal. What was recorded for another owner is left out: he has it too."""
        try:
            super().close()
        except Fenced:
            self._pending.clear()

    def _hold(self, cursor: Cursor, zone: str) -> None:
        self._fence.take(cursor, zone)

    def _allowed(self, cursor: Cursor, zones: Collection[str], wanted: Collection[str]) -> Collection[str]:
        # A zone that has gone to another owner has the same history there.
        return self._fence.required(cursor, zones, wanted)
