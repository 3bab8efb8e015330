"""The journal's file: its schema, how it is opened, and how its errors are told."""

from __future__ import annotations

import logging
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from service.errors import JournalError
from service.store.durable_files import SPACE, make_folder

SCHEMA_VERSION = 3
_LOG_MAGIC = bytes.fromhex("377f06")
LOG_LIMIT = 4 * 2**20
"""Bytes that the write-ahead log keeps when it begins anew."""

_log = logging.getLogger(__name__)

_SCHEMA = """
CREATE TABLE samples (
    zone TEXT NOT NULL, time INTEGER NOT NULL, outputs BLOB NOT NULL, inputs BLOB NOT NULL,
    output_quality TEXT NOT NULL, input_quality TEXT NOT NULL, skipped TEXT, link INTEGER, setpoint REAL,
    PRIMARY KEY (zone, time)
) WITHOUT ROWID;
CREATE TABLE zones (zone TEXT PRIMARY KEY, fingerprint TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE history (
    zone TEXT NOT NULL, time INTEGER NOT NULL, y REAL, mean REAL, lower REAL, upper REAL, sd REAL, residual REAL,
    alpha_lower REAL, alpha_median REAL, alpha_upper REAL, cdf REAL, gate REAL, n_eff REAL, resampled INTEGER,
    log_likelihood REAL, segment INTEGER, checksum INTEGER, gain_lower REAL, gain_median REAL, gain_upper REAL,
    setpoint REAL,
    PRIMARY KEY (zone, time)
) WITHOUT ROWID;
CREATE TABLE pruned (zone TEXT PRIMARY KEY, time INTEGER NOT NULL, link INTEGER) WITHOUT ROWID;
CREATE TABLE forgotten (zone TEXT PRIMARY KEY) WITHOUT ROWID;
CREATE TABLE readings (
    zone TEXT NOT NULL, time REAL NOT NULL, channel TEXT NOT NULL, value REAL NOT NULL, quality TEXT NOT NULL,
    checksum INTEGER NOT NULL, PRIMARY KEY (zone, time, channel)
) WITHOUT ROWID;
"""


def open_database(path: Path, busy_seconds: float) -> sqlite3.Connection:
    """A connection to the journal at `path`, which is created with its folder.

    JournalError for other files, other schemas, and whatever the disk does.
    """
    try:
        make_folder(path.parent)
        with suppress(FileExistsError):
            # SQLite would let every account read it.
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
    except OSError as error:
        raise JournalError(f"the folder of the journal {path} cannot be used: {error.strerror}") from error
    with translated(path):
        connection = sqlite3.connect(path, timeout=busy_seconds, check_same_thread=False)
    try:
        with translated(path):
            _prepare(connection, path)
    except JournalError:
        connection.close()
        raise
    return connection


def schema_problem(connection: sqlite3.Connection) -> str | None:
    """What in the file is no part of a journal, such as a trigger, which would run with every write; or is missing.
    None if all is as it should be."""
    there, expected = _schema(connection), _expected_schema()
    if strange := [entry for entry in there if entry not in expected]:
        return f"has the {strange[0].kind} '{strange[0].name[:40]}', which does not belong into it"
    missing = [entry for entry in expected if entry not in there]
    return f"lacks the table '{missing[0].name}'" if missing else None


class _Entry(NamedTuple):
    """A table, index, view or trigger, and the statement that makes it, with single blanks."""

    kind: str
    name: str
    statement: str


def _schema(connection: sqlite3.Connection) -> list[_Entry]:
    # As bytes: what a damaged disk makes of text may be none. The table `unchecked` is of no use since all rows have
    # checksums; journals of before have it.
    rows = connection.execute(
        "SELECT CAST(type AS BLOB), CAST(name AS BLOB), CAST(coalesce(sql, '') AS BLOB) FROM sqlite_master "
        "WHERE type != 'table' OR name != 'unchecked'"
    ).fetchall()
    return [_Entry(*(" ".join(text.decode("utf-8", "replace").split()) for text in row)) for row in rows]


@lru_cache(maxsize=1)
def _expected_schema() -> list[_Entry]:
    """What a journal made by this version consists of."""
    with closing(sqlite3.connect(":memory:")) as model:
        model.executescript(_SCHEMA)
        return _schema(model)


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    connection.isolation_level = None
    connection.execute("PRAGMA trusted_schema = OFF")
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    empty = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0
    if version > SCHEMA_VERSION:
        raise JournalError(
            f"the journal {path} has schema {version} of a newer Thermogate (this one reads {SCHEMA_VERSION}); "
            "upgrade Thermogate or use another state_dir"
        )
    if version == 0 and not empty:
        raise JournalError(f"{path} is an SQLite file, but not a Thermogate journal; use another state_dir")
    if 0 < version < SCHEMA_VERSION:
        raise JournalError(
            f"the journal {path} has schema {version} of an unreleased Thermogate, which this one does not read; use "
            "another state_dir"
        )
    if empty:
        # Only a file that is made with this can give space back to the disk later.
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
    else:
        _check_schema(connection, path)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute(f"PRAGMA journal_size_limit = {LOG_LIMIT}")
    if not empty and _has_lost_commits(connection, path):
        _log.warning(
            "the write-ahead log %s-wal is damaged, and what was accepted last is lost behind that place; look in the "
            "kernel's log whether its disk has failed: sources that keep what they measured are read again from there, "
            "what clients had posted has to be posted again",
            path,
        )
    if empty:
        connection.executescript(f"BEGIN IMMEDIATE; {_SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;")


def _has_lost_commits(connection: sqlite3.Connection, path: Path) -> bool:
    """Whether a commit lies in the log behind the place where SQLite takes it to end, as after a crash it does not."""
    try:
        _, valid, _ = connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
    except sqlite3.OperationalError:
        # A disk without space is told with the first sample.
        return False
    (page,) = connection.execute("PRAGMA page_size").fetchone()
    with suppress(FileNotFoundError), open(f"{path}-wal", "rb") as log:
        header = log.read(32)
        if header and header[:3] != _LOG_MAGIC:
            return True
        log.seek(32 + valid * (24 + page))
        while len(frame := log.read(24)) == 24:
            # What an earlier round has left there has two other salts; the last frame of a commit has a size.
            if (frame[8:12] == header[16:20] or frame[12:16] == header[20:24]) and frame[4:8] != bytes(4):
                return True
            log.seek(page, os.SEEK_CUR)
    return False


def _check_schema(connection: sqlite3.Connection, path: Path) -> None:
    if (problem := schema_problem(connection)) is not None:
        raise JournalError(
            f"the journal {path} {problem}, as no Thermogate writes it; restore a backup from before, or move it away: "
            "the zones go on from their checkpoints with an empty history"
        )


@contextmanager
def translated(path: Path) -> Iterator[None]:
    """Turn sqlite3's errors into one sentence with the place and the remedy."""
    try:
        yield
    except (sqlite3.Error, UnicodeDecodeError) as error:
        # Of a damaged schema SQLite quotes a part, line breaks included.
        said = " ".join(str(error).split())
        raise JournalError(f"the journal {path} failed ({said}); {_remedy(error)}") from error


def _remedy(error: Exception) -> str:
    # What SQLite says of a damaged schema quotes it, and is then no text either.
    name = "SQLITE_CORRUPT" if isinstance(error, UnicodeDecodeError) else getattr(error, "sqlite_errorname", "")
    # A disk that fails to read looks the same to SQLite as a file that is damaged.
    damaged = (
        "look in the kernel's log whether its disk has failed, and start again; if the file itself is damaged, restore "
        "a backup, or move it away: the zones go on from their checkpoints with an empty history"
    )
    remedies = {
        "SQLITE_FULL": SPACE,
        "SQLITE_BUSY": "stop the other process that writes to it",
        "SQLITE_LOCKED": "stop the other process that writes to it",
        "SQLITE_READONLY": "make the file and its folder writable",
        "SQLITE_CANTOPEN": "make its folder readable and writable",
        "SQLITE_CORRUPT": damaged,
        "SQLITE_NOTADB": damaged,
    }
    # Extended codes append to the primary name, such as SQLITE_READONLY_DIRECTORY.
    for primary, remedy in remedies.items():
        if name.startswith(primary):
            return remedy
    return "check the disk it is on"
