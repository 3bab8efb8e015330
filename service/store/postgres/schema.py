"""The tables of a site: those of the journal, with the lease of every zone, and the checkpoints."""

import logging
import zlib
from importlib.metadata import version

from service.errors import JournalError
from service.store.database import SCHEMA, Cursor, other_version
from service.store.postgres.database import PostgresDatabase

SCHEMA_VERSION = 2

_TYPES = {"INTEGER": "bigint", "REAL": "float8", "BLOB": "bytea", " WITHOUT ROWID": ""}
_LEASED = """
CREATE TABLE migrations (version integer PRIMARY KEY, thermogate text NOT NULL);
CREATE TABLE leases (
    name text PRIMARY KEY, owner text, epoch bigint NOT NULL, expires timestamptz NOT NULL,
    -- The epoch is part of a key: whoever writes keeps it from being changed, and not the lease from being renewed.
    UNIQUE (name, epoch)
);
ALTER TABLE zones ADD COLUMN lease text, ADD COLUMN epoch bigint;
CREATE TABLE checkpoints (
    step bigint NOT NULL, zone text NOT NULL, damaged boolean NOT NULL DEFAULT false, content bytea NOT NULL,
    PRIMARY KEY (zone, step)
);
-- Particles do not compress, and trying takes longer than writing them.
ALTER TABLE checkpoints ALTER COLUMN content SET STORAGE EXTERNAL;
-- Every checkpoint replaces another one; the space of those has to be found soon.
ALTER TABLE checkpoints SET (autovacuum_vacuum_scale_factor = 0.05, toast.autovacuum_vacuum_scale_factor = 0.05);
"""

_log = logging.getLogger(__name__)


def prepare(database: PostgresDatabase) -> None:
    """Create the tables unless they are there. JournalError for those of another version."""
    if applied(database) == 0:
        database.transaction(lambda cursor: _create(cursor, database))
    if (there := applied(database)) != SCHEMA_VERSION:
        raise JournalError(other_version(database.place, there, SCHEMA_VERSION, "database"))


def warn_of_unsafe_commits(database: PostgresDatabase) -> None:
    """Say in the log what lets the server lose what it has acknowledged."""
    for (name,) in database.read(
        "SELECT name FROM pg_settings WHERE name IN ('fsync', 'full_page_writes') AND setting = 'off'"
    ):
        _log.warning(
            "%s runs with %s = off: what was accepted may be lost when its machine fails; switch it on",
            database.place,
            name,
        )


def applied(database: PostgresDatabase) -> int:
    """The version of the tables; 0 if there are none."""
    there = database.read("SELECT to_regclass(?) IS NOT NULL", f'"{database.schema}".migrations')
    return int(database.read("SELECT max(version) FROM migrations")[0][0] or 0) if there[0][0] else 0


def _create(cursor: Cursor, database: PostgresDatabase) -> None:
    # Of all shards that start at once, one does it.
    lock = zlib.crc32(f"thermogate {database.schema}".encode())
    cursor.execute("SELECT pg_advisory_xact_lock(?)", lock)
    if cursor.execute("SELECT to_regclass(?) IS NOT NULL", f'"{database.schema}".migrations').fetchone()[0]:
        return
    cursor.execute(f'CREATE SCHEMA IF NOT EXISTS "{database.schema}"')
    tables = SCHEMA
    for ours, theirs in _TYPES.items():
        tables = tables.replace(ours, theirs)
    for statement in f"{tables}{_LEASED}".split(";\n"):
        if statement.strip():
            cursor.execute(statement)
    cursor.execute("INSERT INTO migrations VALUES (?, ?)", SCHEMA_VERSION, version("thermogate"))
    _log.info("%s has tables of version %d", database.place, SCHEMA_VERSION)
