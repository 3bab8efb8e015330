"""The state of a site in PostgreSQL read and left as it is, whether a fleet runs on it or not."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import closing, contextmanager

from service.errors import CheckpointError, JournalError, ServiceError
from service.store.checkpoint import DAMAGE, Checkpoint, decode
from service.store.postgres.database import Database
from service.store.postgres.fence import Fence
from service.store.postgres.journal import PostgresJournal
from service.store.postgres.leases import Lease
from service.store.postgres.schema import SCHEMA_VERSION, applied

_NOBODY = Lease("reader", "nobody", 0, 0.0)
"""A lease that was never given: nothing is written under it."""

_log = logging.getLogger(__name__)


class StoredSite:
    """Journal and checkpoints of a site. Nothing is written, locked or marked."""

    def __init__(self, database: Database) -> None:
        self.journal = PostgresJournal(database, Fence(_NOBODY))
        self._database = database

    def zones(self) -> dict[str, str]:
        """The fingerprint of every zone with samples, by its id."""
        query = "SELECT zone, fingerprint FROM zones WHERE EXISTS (SELECT 1 FROM samples WHERE zone = number)"
        return dict(self._database.read(query))

    def checkpoint(self, zone: str, fingerprint: str) -> Checkpoint | None:
        """The newest sound checkpoint of `zone` that belongs to `fingerprint`; None if there is none."""
        query = (
            "SELECT step, content FROM checkpoints WHERE zone = (SELECT number FROM zones WHERE zone = %s) "
            "AND NOT damaged ORDER BY step DESC"
        )
        for step, content in self._database.read(query, zone):
            place = f"at {step} of zone '{zone}' in the database {self._database.place}"
            try:
                found = decode(content, place)
            except (*DAMAGE, CheckpointError) as error:
                _log.warning("the checkpoint %s is left out: %s", place, error)
                continue
            return found if found.fingerprint == fingerprint else None
        return None


@contextmanager
def read_site(connection: str, site: str) -> Iterator[StoredSite]:
    """The state of `site` in the database that `connection` names.

    ServiceError where there is none, where another version of Thermogate wrote it, and where it cannot be read.
    """
    with closing(Database(connection, site)) as database:
        version = applied(database)
        if version == 0:
            raise ServiceError(
                f"there is no state of the site '{site}' in the database {database.place}; name the configuration that "
                "its fleet runs with"
            )
        if version != SCHEMA_VERSION:
            remedy = "upgrade Thermogate" if version > SCHEMA_VERSION else "run the fleet on it once, which upgrades it"
            raise JournalError(
                f"the database {database.place} has version {version}, and this reads {SCHEMA_VERSION}; {remedy}"
            )
        yield StoredSite(database)
