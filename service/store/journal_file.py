"""The journal's file: how it is opened, written and shrunk by SQLite, and how its errors are told."""

import logging
import os
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Self

from service.errors import JournalError
from service.store.database import SCHEMA, Cursor, Database, Result, other_version
from service.store.durable_files import SPACE, make_folder

SCHEMA_VERSION = 3
BUSY_SECONDS = 5.0
PAGES_AT_ONCE = 128
"""Free pages that are given back to the disk in one go."""
_ROWS_AT_ONCE = 250
"""SQLite takes 32,766 values in a statement; the widest row has 22."""
_LOG_MAGIC = bytes.fromhex("377f06")
LOG_LIMIT = 4 * 2**20
"""Bytes that the write-ahead log keeps when it begins anew."""

_log = logging.getLogger(__name__)


class JournalFile(Database):
    """The journal in an SQLite file: with a write-ahead log, and each commit on the disk."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        """The file at `path` over a `connection`, which `open` makes; over one that only reads it is looked at."""
        self.place = f"the journal {path}"
        self._connection, self._path = connection, path
        self._watched: dict[Path, tuple[int, int] | None] = {}

    @classmethod
    def open(cls, path: Path) -> Self:
        """The file at `path`, which is created with its folder; other files and schemas are refused."""
        try:
            make_folder(path.parent)
            with suppress(FileExistsError):
                # SQLite would let every account read it.
                os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
        except OSError as error:
            raise JournalError(f"the folder of the journal {path} cannot be used: {error.strerror}") from error
        with translated(path):
            connection = sqlite3.connect(path, timeout=BUSY_SECONDS, check_same_thread=False)
        try:
            with translated(path):
                _prepare(connection, path)
        except BaseException:
            connection.close()
            raise
        return cls(connection, path)

    def read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        with translated(self._path):
            return self._connection.execute(query, values).fetchall()

    def watch(self, *files: Path) -> None:
        """Write nothing any more once these are no longer the files that they are now: it would be lost with the
        process."""
        self._watched = {file: _identity(file) for file in files}

    def transaction(self, work: Callable[[Cursor], Result]) -> Result:
        self._look()
        with translated(self._path):
            cursor = _Cursor(self._connection)
            try:
                cursor.execute("BEGIN IMMEDIATE")
                result = work(cursor)
                cursor.execute("COMMIT")
            except BaseException:
                # A full disk makes SQLite roll back by itself.
                if self._connection.in_transaction:
                    cursor.execute("ROLLBACK")
                raise
        self._look()
        return result

    def size(self) -> int:
        """Bytes that the file takes, with those that its write-ahead log is allowed."""
        return int(self.read("PRAGMA page_count")[0][0] * self.read("PRAGMA page_size")[0][0]) + LOG_LIMIT

    def shrink(self) -> bool:
        free = self.read("PRAGMA freelist_count")
        with translated(self._path):
            # Of what it returns a page is freed at each step, and only a script takes all of them.
            self._connection.executescript(f"PRAGMA incremental_vacuum({PAGES_AT_ONCE:d})")
        return self.read("PRAGMA freelist_count") < free

    def close(self) -> None:
        self._connection.close()

    def _look(self) -> None:
        lost = [file.name for file, identity in self._watched.items() if _identity(file) != identity]
        if not lost:
            if self.trouble is not None:
                _log.info("site.state_dir %s is back", self._path.parent)
            self.trouble = None
            return
        trouble = (
            f"site.state_dir {self._path.parent} has been deleted or replaced while the daemon runs "
            f"({' and '.join(lost)}); nothing is accepted, because it would be lost; put the folder back, or start the "
            "daemon again"
        )
        if self.trouble is None:
            _log.error("%s", trouble)
        self.trouble = trouble
        raise JournalError(trouble)


class _Cursor:
    def __init__(self, connection: sqlite3.Connection) -> None:
        self._cursor = connection.cursor()

    def execute(self, query: str, *values: object) -> sqlite3.Cursor:
        return self._cursor.execute(query, values)

    def insert(self, into: str, rows: Sequence[tuple[object, ...]], otherwise: str = "") -> None:
        """Insert many rows by one statement: after every one the interpreter lock has to be won back from threads that
        compute, which for a thousand zones would take longer than the writing."""
        for first in range(0, len(rows), _ROWS_AT_ONCE):
            part = rows[first : first + _ROWS_AT_ONCE]
            places = ", ".join([f"({', '.join('?' * len(part[0]))})"] * len(part))
            self.execute(f"INSERT INTO {into} VALUES {places} {otherwise}", *(value for row in part for value in row))  # noqa: S608


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def schema_problem(connection: sqlite3.Connection) -> str | None:
    """What in the file is no part of a journal, such as a trigger, which would run with every write; or is missing.
    None if all is as it should be."""
    there, expected = _schema(connection), _expected_schema()
    for kind, name, _ in (entry for entry in there if entry not in expected):
        return f"has the {kind} '{name[:40]}', which does not belong into it"
    for _, name, _ in (entry for entry in expected if entry not in there):
        return f"lacks the table '{name}'"
    return None


def _schema(connection: sqlite3.Connection) -> list[tuple[str, str, str]]:
    """Kind and name of every table, index, view and trigger, and the statement that makes it, with single blanks."""
    # As bytes: what a damaged disk makes of text may be none. The table `unchecked` is of no use since all rows have
    # checksums; journals of before have it.
    rows = connection.execute(
        "SELECT CAST(type AS BLOB), CAST(name AS BLOB), CAST(coalesce(sql, '') AS BLOB) FROM sqlite_master "
        "WHERE type != 'table' OR name != 'unchecked'"
    )
    words = [[" ".join(text.decode("utf-8", "replace").split()) for text in row] for row in rows]
    return [(kind, name, statement) for kind, name, statement in words]


@cache
def _expected_schema() -> list[tuple[str, str, str]]:
    """What a journal made by this version consists of."""
    with closing(sqlite3.connect(":memory:")) as model:
        model.executescript(SCHEMA)
        return _schema(model)


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    connection.isolation_level = None
    connection.execute("PRAGMA trusted_schema = OFF")
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    empty = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0
    if version == 0 and not empty:
        raise JournalError(f"{path} is an SQLite file, but not a Thermogate journal; use another state_dir")
    if version not in (0, SCHEMA_VERSION):
        raise JournalError(other_version(f"the journal {path}", version, SCHEMA_VERSION, "state_dir"))
    if empty:
        # Only a file that is made with this can give space back to the disk later.
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
    elif (problem := schema_problem(connection)) is not None:
        raise JournalError(
            f"the journal {path} {problem}, as no Thermogate writes it; restore a backup from before, or move it away: "
            "the zones go on from their checkpoints with an empty history"
        )
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
        connection.executescript(f"BEGIN IMMEDIATE; {SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;")


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
