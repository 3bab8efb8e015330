"""The state of a site in PostgreSQL read and left as it is, whether a fleet runs on it or not."""

from collections.abc import Iterator
from contextlib import closing, contextmanager

from service.errors import JournalError, ServiceError
from service.store.database import other_version
from service.store.journal import Journal
from service.store.postgres.checkpoints import PostgresCheckpoints
from service.store.postgres.database import PostgresDatabase
from service.store.postgres.schema import SCHEMA_VERSION, applied
from service.store.reading import StoredState


@contextmanager
def read_site(connection: str, site: str) -> Iterator[StoredState]:
    """The state of `site` in the database that `connection` names. ServiceError where there is none, where another
    version of Thermogate wrote it, and where it cannot be read."""
    with closing(PostgresDatabase(connection, site, read_only=True)) as database:
        version = applied(database)
        if version == 0:
            raise ServiceError(
                f"there is no state of the site '{site}' in {database.place}; name the configuration that its fleet "
                "runs with"
            )
        if version != SCHEMA_VERSION:
            raise JournalError(other_version(database.place, version, SCHEMA_VERSION, "database"))
        yield StoredState(Journal(database), PostgresCheckpoints(database))
