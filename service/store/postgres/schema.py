"""The tables of a site, and how they are created and upgraded.

Rows carry a zone's number, not its name: they are shorter, and all rows of a zone are set aside by renaming it.
`samples` and `history` are partitioned by month (`service.store.postgres.partitions`).
"""

from __future__ import annotations

import logging
import zlib
from importlib.metadata import version

from service.errors import JournalError
from service.store.postgres.database import Cursor, Database

_log = logging.getLogger(__name__)

_VERSION_1 = """
CREATE TABLE leases (
    name text PRIMARY KEY, owner text, epoch bigint NOT NULL, expires timestamptz NOT NULL,
    -- The epoch is part of a key: whoever writes keeps it from being changed, and not the lease from being renewed.
    UNIQUE (name, epoch)
);
CREATE TABLE zones (
    number integer GENERATED ALWAYS AS IDENTITY PRIMARY KEY, zone text NOT NULL UNIQUE,
    fingerprint text, lease text, epoch bigint, pruned bigint, pruned_link bigint
);
CREATE TABLE samples (
    time bigint NOT NULL, link bigint NOT NULL, zone integer NOT NULL, outputs bytea NOT NULL, inputs bytea NOT NULL,
    output_quality text NOT NULL, input_quality text NOT NULL, setpoint float8, skipped text, PRIMARY KEY (zone, time)
) PARTITION BY RANGE (time);
CREATE TABLE history (
    time bigint NOT NULL, y float8, mean float8, lower float8, upper float8, sd float8, residual float8,
    alpha_lower float8, alpha_median float8, alpha_upper float8, cdf float8, gate float8, n_eff float8,
    log_likelihood float8, gain_lower float8, gain_median float8, gain_upper float8, setpoint float8,
    checksum bigint NOT NULL, zone integer NOT NULL, segment integer, resampled boolean,
    PRIMARY KEY (zone, time)
) PARTITION BY RANGE (time);
CREATE TABLE readings (
    time float8 NOT NULL, value float8 NOT NULL, checksum bigint NOT NULL, zone integer NOT NULL,
    channel text NOT NULL, quality text NOT NULL, PRIMARY KEY (zone, time, channel)
);
CREATE TABLE checkpoints (
    step bigint NOT NULL, zone integer NOT NULL, damaged boolean NOT NULL DEFAULT false, content bytea NOT NULL,
    PRIMARY KEY (zone, step)
);
-- Particles do not compress, and trying takes longer than writing them.
ALTER TABLE checkpoints ALTER COLUMN content SET STORAGE EXTERNAL;
-- Every checkpoint replaces another one; the space of those has to be found soon.
ALTER TABLE checkpoints SET (autovacuum_vacuum_scale_factor = 0.05, toast.autovacuum_vacuum_scale_factor = 0.05);
"""

_MIGRATIONS = (_VERSION_1,)
"""What leads to version 1, 2, ...; each is run once, in one transaction."""

SCHEMA_VERSION = len(_MIGRATIONS)


def prepare(database: Database) -> None:
    """Create the tables, or bring them up to the present version. JournalError for newer ones."""
    there = applied(database)
    if there < SCHEMA_VERSION:
        database.transaction(lambda cursor: _upgrade(cursor, database))
    elif there > SCHEMA_VERSION:
        raise JournalError(
            f"the database {database.place} has version {there} of a newer Thermogate (this one reads "
            f"{SCHEMA_VERSION}); upgrade Thermogate, or use another database"
        )


def warn_of_unsafe_commits(database: Database) -> None:
    """Say in the log what lets the server lose what it has acknowledged."""
    for (name,) in database.read(
        "SELECT name FROM pg_settings WHERE name IN ('fsync', 'full_page_writes') AND setting = 'off'"
    ):
        _log.warning(
            "the database %s runs with %s = off: what was accepted may be lost when its machine fails; switch it on",
            database.place,
            name,
        )


def applied(database: Database) -> int:
    """The version of the tables; 0 if there are none."""
    there = database.read("SELECT to_regclass(%s) IS NOT NULL", f'"{database.schema}".migrations')
    return int(database.read("SELECT max(version) FROM migrations")[0][0] or 0) if there[0][0] else 0


def _upgrade(cursor: Cursor, database: Database) -> None:
    # Of all shards that start at once, one does it.
    cursor.execute("SELECT pg_advisory_xact_lock(%s)", (lock_of(database.schema),))
    if cursor.execute("SELECT to_regnamespace(%s) IS NULL", (f'"{database.schema}"',)).fetchone()[0]:
        cursor.execute(f'CREATE SCHEMA "{database.schema}"')
    cursor.execute(
        "CREATE TABLE IF NOT EXISTS migrations (version integer PRIMARY KEY, thermogate text NOT NULL, "
        "applied timestamptz NOT NULL DEFAULT clock_timestamp())"
    )
    (there,) = cursor.execute("SELECT coalesce(max(version), 0) FROM migrations").fetchone()
    for number, statements in enumerate(_MIGRATIONS[there:], start=there + 1):
        for statement in statements.split(";\n"):
            if statement.strip():
                cursor.execute(statement)
        cursor.execute("INSERT INTO migrations VALUES (%s, %s)", (number, version("thermogate")))
        _log.info("the database %s has tables of version %d", database.place, number)


def lock_of(schema: str) -> int:
    """The number of the lock under which tables of `schema` are created and dropped."""
    return zlib.crc32(f"thermogate {schema}".encode())
