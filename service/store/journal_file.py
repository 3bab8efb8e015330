"""The journal's file: its schema, how it is opened, brought up from earlier versions, and how its errors are told."""

from __future__ import annotations

import logging
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

from service.errors import JournalError
from service.store.durable_files import SPACE, make_folder

SCHEMA_VERSION = 3
LOG_LIMIT = 4 * 2**20
"""Bytes that the write-ahead log keeps when it begins anew."""
_LOG_HEADER = 32
_LOG_MAGIC = (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83")
_PAGE_SIZE = 4096

_SCHEMA = """
CREATE TABLE samples (
    zone TEXT NOT NULL, time INTEGER NOT NULL, outputs BLOB NOT NULL, inputs BLOB NOT NULL,
    output_quality TEXT NOT NULL, input_quality TEXT NOT NULL, skipped TEXT, link INTEGER,
    PRIMARY KEY (zone, time)
) WITHOUT ROWID;
CREATE TABLE zones (zone TEXT PRIMARY KEY, fingerprint TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE history (
    zone TEXT NOT NULL, time INTEGER NOT NULL, y REAL, mean REAL, lower REAL, upper REAL, sd REAL, residual REAL,
    alpha_lower REAL, alpha_median REAL, alpha_upper REAL, cdf REAL, gate REAL, n_eff REAL, resampled INTEGER,
    log_likelihood REAL, segment INTEGER, checksum INTEGER,
    PRIMARY KEY (zone, time)
) WITHOUT ROWID;
"""

_SINCE_VERSION_2 = """
CREATE TABLE pruned (zone TEXT PRIMARY KEY, time INTEGER NOT NULL, link INTEGER) WITHOUT ROWID;
CREATE TABLE forgotten (zone TEXT PRIMARY KEY) WITHOUT ROWID;
CREATE TABLE unchecked (zone TEXT PRIMARY KEY, time INTEGER NOT NULL) WITHOUT ROWID;
"""

_READINGS = """
CREATE TABLE IF NOT EXISTS readings (
    zone TEXT NOT NULL, time REAL NOT NULL, channel TEXT NOT NULL, value REAL NOT NULL, quality TEXT NOT NULL,
    checksum INTEGER NOT NULL, PRIMARY KEY (zone, time, channel)
) WITHOUT ROWID;
"""
"""Of a kind that a version 2 of before does without: it opens the file all the same."""

_FROM_VERSION_1 = f"""
ALTER TABLE samples ADD COLUMN link INTEGER;
ALTER TABLE history ADD COLUMN checksum INTEGER;
{_SINCE_VERSION_2}
INSERT INTO unchecked SELECT zone, max(time)
    FROM (SELECT zone, time FROM samples UNION ALL SELECT zone, time FROM history) GROUP BY zone;
"""
"""Rows up to these times have no checksums; every later one must have its own."""

_SINCE_VERSION_3 = """
ALTER TABLE samples ADD COLUMN setpoint REAL;
ALTER TABLE history ADD COLUMN gain_lower REAL;
ALTER TABLE history ADD COLUMN gain_median REAL;
ALTER TABLE history ADD COLUMN gain_upper REAL;
ALTER TABLE history ADD COLUMN setpoint REAL;
"""
"""NULL in every row of before, whose checksums hold all the same."""

_log = logging.getLogger(__name__)


def open_database(path: Path, busy_seconds: float) -> sqlite3.Connection:
    """A connection to the journal at `path`, which is created with its folder, or brought up to the present schema.

    JournalError for other files, newer schemas, and whatever the disk does.
    """
    try:
        make_folder(path.parent)
        with suppress(FileExistsError):
            # SQLite would let every account read it.
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
        _check_size(path)
        written = _commits_in_log(path)
    except OSError as error:
        raise JournalError(f"the folder of the journal {path} cannot be used: {error.strerror}") from error
    with translated(path):
        connection = sqlite3.connect(path, timeout=busy_seconds, check_same_thread=False)
    try:
        with translated(path):
            _prepare(connection, path)
            _compare_log(connection, path, written)
    except JournalError:
        connection.close()
        raise
    return connection


def schema_problem(connection: sqlite3.Connection) -> str | None:
    """What in the file is no part of a journal, such as a trigger, which would run with every write; or is missing.
    None if all is as it should be. A file of an earlier version, which lacks something, is only looked at for more."""
    present = connection.execute("PRAGMA user_version").fetchone()[0] == SCHEMA_VERSION
    there, expected = _schema(connection), _expected_schema()
    strange = [entry for entry in there if entry not in expected] if present else []
    strange += [entry for entry in there if entry.kind != "table"]
    if strange:
        return f"has the {strange[0].kind} '{strange[0].name[:40]}', which does not belong into it"
    missing = [entry for entry in expected if entry not in there and entry.name != "readings"] if present else []
    return f"lacks the table '{missing[0].name}'" if missing else None


class _Entry(NamedTuple):
    """A table, index, view or trigger, and the statement that makes it, with single blanks."""

    kind: str
    name: str
    statement: str


def _schema(connection: sqlite3.Connection) -> list[_Entry]:
    # As bytes: what a damaged disk makes of text may be none.
    rows = connection.execute(
        "SELECT CAST(type AS BLOB), CAST(name AS BLOB), CAST(coalesce(sql, '') AS BLOB) FROM sqlite_master"
    ).fetchall()
    return [_Entry(*(" ".join(text.decode("utf-8", "replace").split()) for text in row)) for row in rows]


@lru_cache(maxsize=1)
def _expected_schema() -> list[_Entry]:
    """What a journal made by this version consists of."""
    with closing(sqlite3.connect(":memory:")) as model:
        model.executescript(_SCHEMA + _SINCE_VERSION_2 + _SINCE_VERSION_3 + _READINGS)
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
    _check_schema(connection, path)
    if version < 2:
        # Only a file that is made or rewritten with this can give space back to the disk later.
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute(f"PRAGMA journal_size_limit = {LOG_LIMIT}")
    if empty:
        _script(connection, _SCHEMA + _SINCE_VERSION_2 + _SINCE_VERSION_3)
    elif version == 1:
        _log.info("the journal %s is brought up from version 1, which takes as much space again for a moment", path)
        connection.execute("VACUUM")
        _script(connection, _FROM_VERSION_1 + _SINCE_VERSION_3)
    elif version == 2:
        _script(connection, _SINCE_VERSION_3)
    if not connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'readings'").fetchone():
        _script(connection, _READINGS)
    _check_schema(connection, path)


def _check_schema(connection: sqlite3.Connection, path: Path) -> None:
    if (problem := schema_problem(connection)) is not None:
        raise JournalError(
            f"the journal {path} {problem}, as no Thermogate writes it; restore a backup from before, or move it away: "
            "the zones go on from their checkpoints with an empty history"
        )


def _script(connection: sqlite3.Connection, statements: str) -> None:
    try:
        connection.executescript(f"BEGIN IMMEDIATE; {statements} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;")
    except sqlite3.Error:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def _commits_in_log(path: Path) -> list[int]:
    """Numbers of the frames that end a transaction in the write-ahead log at `path`, as far as its own marks tell.

    The layout is that of SQLite's file format, section 4: a header with page size and two salts, then frames of 24
    bytes and a page, each with the salts, and the size of the database if it ends a transaction.
    """
    log = path.with_name(f"{path.name}-wal")
    content = log.read_bytes() if log.exists() else b""
    if len(content) <= _LOG_HEADER:
        return []
    page_size, salts = int.from_bytes(content[8:12], "big"), content[16:24]
    if not _header_is_sound(content[:_LOG_HEADER]):
        # SQLite takes it for empty. What was in it is only to be guessed, but it is more than nothing.
        page_size, salts = _PAGE_SIZE, content[_LOG_HEADER + 8 : _LOG_HEADER + 16]
    frames = range(_LOG_HEADER, len(content) - page_size - 23, 24 + page_size)
    commits = [
        number
        for number, at in enumerate(frames, start=1)
        # Frames of earlier rounds have neither of the two salts; one is enough where a bit of the other has flipped.
        if any(content[at + 4 : at + 8])
        and (content[at + 8 : at + 12] == salts[:4] or content[at + 12 : at + 16] == salts[4:])
    ]
    return commits or ([] if _header_is_sound(content[:_LOG_HEADER]) else [1])


def _header_is_sound(header: bytes) -> bool:
    """Whether the checksum in the header of a write-ahead log is right."""
    if header[:4] not in _LOG_MAGIC:
        return False
    order: Literal["big", "little"] = "big" if header[3] & 1 else "little"
    first = second = 0
    for at in range(0, 24, 8):
        first = (first + int.from_bytes(header[at : at + 4], order) + second) & 0xFFFFFFFF
        second = (second + int.from_bytes(header[at + 4 : at + 8], order) + first) & 0xFFFFFFFF
    return header[24:] == first.to_bytes(4, "big") + second.to_bytes(4, "big")


def _compare_log(connection: sqlite3.Connection, path: Path, written: list[int]) -> None:
    """Say what SQLite passed over in silence: it takes a damaged frame for the end of the write-ahead log."""
    if not written:
        return
    _, accepted, _ = connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
    lost = sum(number > accepted for number in written)
    if lost:
        _log.warning(
            "the last %d transactions in %s-wal cannot be read and are left out; one that was under way is usual after "
            "a power failure, anything else is damage to the disk",
            lost,
            path,
        )


def _check_size(path: Path) -> None:
    """JournalError for a file that is shorter than its own header says (SQLite's file format, 1.3), unless the missing
    pages are in the write-ahead log: SQLite would find out when it comes to them, which may be with the next sample."""
    if not path.exists() or path.with_name(f"{path.name}-journal").exists():
        # Where a rollback journal lies beside it, SQLite first takes back what was being written.
        return
    with path.open("rb") as file:
        header = file.read(100)
    if len(header) < 100 or header[24:28] != header[92:96]:
        return
    size = int.from_bytes(header[16:18], "big")
    page_size = 65536 if size == 1 else size
    there, expected = path.stat().st_size // max(page_size, 1), int.from_bytes(header[28:32], "big")
    if there >= expected:
        return
    log = path.with_name(f"{path.name}-wal")
    content = log.read_bytes() if log.exists() else b""
    frames = range(_LOG_HEADER, len(content) - page_size - 23, 24 + page_size)
    logged = {int.from_bytes(content[at : at + 4], "big") for at in frames}
    if not logged.issuperset(range(there + 1, expected + 1)):
        raise JournalError(
            f"the journal {path} has been cut off: {there} of {expected} pages are there; restore a backup, or move it "
            "away: the zones go on from their checkpoints with an empty history"
        )


@contextmanager
def translated(path: Path) -> Iterator[None]:
    """Turn sqlite3's errors into one sentence with the place and the remedy."""
    try:
        yield
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise JournalError(f"the journal {path} failed ({error}); {_remedy(error)}") from error


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
