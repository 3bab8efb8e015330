"""The store of one shard: its zones' part of the database, written to under its lease."""

from __future__ import annotations

from service.store.journalling import JournalStore
from service.store.postgres.leases import Lease


class PostgresStore(JournalStore):
    """Journal and checkpoints of `site` in the database that `connection` names, written to under `lease`.

    `claim` takes a zone for the lease; until then, and after another owner has taken the zone or the lease, everything
    that writes to the zone raises Fenced. A `ZoneStore`, as is the one of SQLite.
    """

    def __init__(self, connection: str, site: str, lease: Lease) -> None:
        """Opens it, and creates or upgrades the tables. Raises ServiceError with the remedy where that fails."""
        raise NotImplementedError

    async def give_up(self, zone: str) -> None:
        """Leave `zone` to the next owner that claims it, with everything that was recorded durable; stop it before."""
        raise NotImplementedError
