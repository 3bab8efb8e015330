"""The journal: every accepted sample, durable before it is assimilated, and the history that REST serves.

One SQLite file (WAL, synchronous=FULL) in the state directory. Samples are stored as little-endian float64 blobs, so a
replay sees the very bits that the worker saw, NaN included; history columns are plain numbers (NaN is NULL), so that
`sqlite3` on the command line can read them.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adapters.reading import Quality
from service.errors import JournalError
from service.records import Array, Sample, Update

SCHEMA_VERSION = 1
_BUSY_SECONDS = 5.0
_PAGE = 1000
_PENDING_LIMIT = 1000
_ROWS_AT_ONCE = 250
"""SQLite takes 32,766 values in a statement; the widest row has 18."""

_SCHEMA = """
CREATE TABLE samples (
    zone TEXT NOT NULL, time INTEGER NOT NULL, outputs BLOB NOT NULL, inputs BLOB NOT NULL,
    output_quality TEXT NOT NULL, input_quality TEXT NOT NULL, skipped TEXT,
    PRIMARY KEY (zone, time)
) WITHOUT ROWID;
CREATE TABLE zones (zone TEXT PRIMARY KEY, fingerprint TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE history (
    zone TEXT NOT NULL, time INTEGER NOT NULL, y REAL, mean REAL, lower REAL, upper REAL, sd REAL, residual REAL,
    alpha_lower REAL, alpha_median REAL, alpha_upper REAL, cdf REAL, gate REAL, n_eff REAL, resampled INTEGER,
    log_likelihood REAL, segment INTEGER,
    PRIMARY KEY (zone, time)
) WITHOUT ROWID;
"""


class HistoryRow(NamedTuple):
    """One update in numbers: the first output (degC, K) against its forecast, and the first volatility block, if any.

    `mean`, `lower`, `upper`, `sd` and `residual` belong to the forecast that stood before `y` was seen; NaN where there
    was none, and `y` is NaN where it was missing. `time` is UTC seconds.
    """

    time: int
    y: float
    mean: float
    lower: float
    upper: float
    sd: float
    residual: float
    alpha_lower: float
    alpha_median: float
    alpha_upper: float
    cdf: float
    gate: float
    n_eff: float
    resampled: bool
    log_likelihood: float
    segment: int

    @classmethod
    def of(cls, update: Update) -> HistoryRow:
        """The row of `update`."""
        score, volatility = update.score, update.volatility
        scored, alpha = (math.nan,) * 5, (math.nan,) * 4
        if score is not None:
            scored = (score.mean[0], score.lower[0], score.upper[0], score.sd[0], score.residual[0])
        if volatility.blocks:
            alpha = (volatility.lower[0], volatility.median[0], volatility.upper[0], volatility.cdf[0])
        return cls(
            update.time,
            update.y[0],
            *scored,
            *alpha,
            gate=update.gate.value,
            n_eff=update.effective_sample_size,
            resampled=update.resampled,
            log_likelihood=update.log_likelihood,
            segment=update.segment,
        )


_COLUMNS = ", ".join(HistoryRow._fields)
_RECORD = f"INSERT OR REPLACE INTO history (zone, {_COLUMNS})"
_ACCEPT = "INSERT OR IGNORE INTO samples (zone, time, outputs, inputs, output_quality, input_quality)"


class Journal:
    """An open journal. Not for two threads at once; every method may raise JournalError."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection = connection
        self._path = path
        self._pending: list[tuple[object, ...]] = []

    @classmethod
    def open(cls, path: Path) -> Journal:
        """Open the journal at `path`, creating it and its folder; refuses other files and newer schemas."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise JournalError(f"the folder of the journal {path} cannot be made: {error.strerror}") from error
        with _translated(path):
            connection = sqlite3.connect(path, timeout=_BUSY_SECONDS, check_same_thread=False)
        try:
            with _translated(path):
                _prepare(connection, path)
        except JournalError:
            connection.close()
            raise
        return cls(connection, path)

    def claim(self, zone: str, fingerprint: str) -> bool:
        """Whether the samples of `zone` belong to `fingerprint`; a zone without samples takes it over."""
        with self._transaction() as cursor:
            stored = cursor.execute("SELECT fingerprint FROM zones WHERE zone = ?", (zone,)).fetchone()
            used = cursor.execute("SELECT 1 FROM samples WHERE zone = ? LIMIT 1", (zone,)).fetchone()
            if stored is not None and used is not None:
                return bool(stored[0] == fingerprint)
            cursor.execute("INSERT OR REPLACE INTO zones VALUES (?, ?)", (zone, fingerprint))
            return True

    def append(self, zone: str, sample: Sample) -> bool:
        """Store `sample`, durable on return with the history recorded so far; False if its time is already stored."""
        return self.append_all([(zone, sample)]) == 1

    def append_all(self, accepted: Sequence[tuple[str, Sample]]) -> int:
        """Store samples of zones, all or none of them, as `append`; how many were not stored already."""
        rows = [
            (
                zone,
                sample.time,
                _to_blob(sample.outputs),
                _to_blob(sample.inputs),
                ",".join(sample.output_quality),
                ",".join(sample.input_quality),
            )
            for zone, sample in accepted
        ]
        with self._transaction() as cursor:
            return _insert(cursor, _ACCEPT, rows)

    def record(self, zone: str, update: Update) -> None:
        """Add or replace the history row of `update`; durable with the next append, flush or close."""
        self._pending.append((zone, *HistoryRow.of(update)))
        if len(self._pending) >= _PENDING_LIMIT:
            self.flush()

    def flush(self) -> None:
        """Make the recorded history durable."""
        if self._pending:
            with self._transaction():
                pass

    def skip(self, zone: str, time: int, reason: str) -> None:
        """Mark a stored sample as one that must not be assimilated; it stays in the file, with `reason`."""
        with self._transaction() as cursor:
            cursor.execute("UPDATE samples SET skipped = ? WHERE zone = ? AND time = ?", (reason, zone, time))
            if cursor.rowcount == 0:
                raise JournalError(f"the journal {self._path} has no sample of zone '{zone}' at {time} to skip")

    def samples_after(self, zone: str, time: int | None) -> Iterator[Sample]:
        """The samples of `zone` later than `time` (None: all), in order, without the skipped ones.

        A skipped sample is left out, as if its interval had brought nothing. Writing between two items is allowed.
        """
        after = -(2**63) if time is None else time
        query = (
            "SELECT time, outputs, inputs, output_quality, input_quality FROM samples "
            f"WHERE zone = ? AND time > ? AND skipped IS NULL ORDER BY time LIMIT {_PAGE}"
        )
        while True:
            with _translated(self._path):
                rows = self._connection.execute(query, (zone, after)).fetchall()
            for row in rows:
                yield _to_sample(row, self._path)
            if len(rows) < _PAGE:
                return
            after = rows[-1][0]

    def last_sample_time(self, zone: str) -> int | None:
        """Time of the newest stored sample of `zone`, skipped or not."""
        with _translated(self._path):
            query = "SELECT max(time) FROM samples WHERE zone = ?"
            newest: int | None = self._connection.execute(query, (zone,)).fetchone()[0]
            return newest

    def history(self, zone: str, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (None: open), oldest first."""
        # Reading need not wait for the disk because of other zones.
        if any(row[0] == zone for row in self._pending):
            self.flush()
        where, bounds = "zone = ?", [zone]
        for condition, bound in (("time >= ?", start), ("time < ?", end)):
            if bound is not None:
                where += f" AND {condition}"
                bounds.append(bound)  # type: ignore[arg-type]
        query = f"SELECT {_COLUMNS} FROM history WHERE {where} ORDER BY time DESC LIMIT ?"
        with _translated(self._path):
            rows = self._connection.execute(query, (*bounds, limit)).fetchall()
        return [_to_history(row) for row in reversed(rows)]

    def forget(self, zone: str) -> None:
        """Set aside all of `zone`: its rows stay in the file under a name that no zone can have."""
        aside = f"{zone}@{datetime.now(UTC).isoformat()}"
        with self._transaction() as cursor:
            for table in ("samples", "history", "zones"):
                cursor.execute(f"UPDATE {table} SET zone = ? WHERE zone = ?", (aside, zone))

    def samples_ahead(self, zone: str, after: int) -> int:
        """How many samples of `zone` are later than `after`."""
        with _translated(self._path):
            query = "SELECT count(*) FROM samples WHERE zone = ? AND time > ?"
            count: int = self._connection.execute(query, (zone, after)).fetchone()[0]
            return count

    def set_aside(self, zone: str, after: int) -> None:
        """Set aside what is later than `after` of `zone`, as `forget` does with all of it."""
        aside = f"{zone}@{datetime.now(UTC).isoformat()}"
        with self._transaction() as cursor:
            for table in ("samples", "history"):
                cursor.execute(f"UPDATE {table} SET zone = ? WHERE zone = ? AND time > ?", (aside, zone, after))

    def close(self) -> None:
        """Flush and close; safe to call twice."""
        try:
            self.flush()
        finally:
            self._connection.close()

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Cursor]:
        """One durable transaction that also carries the pending history, which is kept for the next try if it fails."""
        with _translated(self._path):
            cursor = self._connection.cursor()
            try:
                cursor.execute("BEGIN IMMEDIATE")
                _insert(cursor, _RECORD, self._pending)
                yield cursor
                cursor.execute("COMMIT")
            except BaseException:
                # A full disk makes SQLite roll back by itself.
                if self._connection.in_transaction:
                    cursor.execute("ROLLBACK")
                raise
        self._pending.clear()


def _insert(cursor: sqlite3.Cursor, statement: str, rows: Sequence[tuple[object, ...]]) -> int:
    """Insert `rows`; how many went in.

    Many rows go into one statement: after every statement the interpreter lock has to be won back from threads that
    compute, which for a thousand zones would take longer than the writing.
    """
    inserted = 0
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        part = rows[first : first + _ROWS_AT_ONCE]
        places = ", ".join([f"({', '.join('?' * len(part[0]))})"] * len(part))
        inserted += cursor.execute(f"{statement} VALUES {places}", [value for row in part for value in row]).rowcount
    return inserted


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    connection.isolation_level = None
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    empty = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0
    if version > SCHEMA_VERSION:
        raise JournalError(
            f"the journal {path} has schema {version} of a newer Thermogate (this one reads {SCHEMA_VERSION}); "
            "upgrade Thermogate or use another state_dir"
        )
    if version == 0 and not empty:
        raise JournalError(f"{path} is an SQLite file, but not a Thermogate journal; use another state_dir")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    if empty:
        connection.executescript(f"BEGIN IMMEDIATE; {_SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;")


@contextmanager
def _translated(path: Path) -> Iterator[None]:
    """Turn sqlite3's errors into one sentence with the place and the remedy."""
    try:
        yield
    except sqlite3.Error as error:
        raise JournalError(f"the journal {path} failed ({error}); {_remedy(error)}") from error


def _remedy(error: sqlite3.Error) -> str:
    name = getattr(error, "sqlite_errorname", "")
    remedies = {
        "SQLITE_FULL": "free space on its disk",
        "SQLITE_BUSY": "stop the other process that writes to it",
        "SQLITE_LOCKED": "stop the other process that writes to it",
        "SQLITE_READONLY": "make the file and its folder writable",
        "SQLITE_CANTOPEN": "make its folder readable and writable",
        "SQLITE_CORRUPT": "move it away; the zones go on from their checkpoints with an empty history",
        "SQLITE_NOTADB": "move it away; the zones go on from their checkpoints with an empty history",
    }
    # Extended codes append to the primary name, such as SQLITE_READONLY_DIRECTORY.
    for primary, remedy in remedies.items():
        if name.startswith(primary):
            return remedy
    return "check the disk it is on"


def _to_blob(values: Array) -> bytes:
    return np.asarray(values, dtype="<f8").tobytes()


def _to_sample(row: tuple[int, bytes, bytes, str, str], path: Path) -> Sample:
    time, *blobs = row[:3]
    try:
        outputs, inputs = (np.frombuffer(blob, dtype="<f8").astype(np.float64) for blob in blobs)
        return Sample(time, outputs, inputs, _qualities(row[3]), _qualities(row[4]))
    except ValueError as error:
        raise JournalError(
            f"the journal {path} holds a sample at {time} that cannot be read ({error}); move the file away"
        ) from error


def _qualities(text: str) -> tuple[Quality, ...]:
    return tuple(Quality(word) for word in text.split(",")) if text else ()


def _to_history(row: tuple[float | None, ...]) -> HistoryRow:
    values = {name: math.nan if value is None else value for name, value in zip(HistoryRow._fields, row, strict=True)}
    return HistoryRow(**(values | {"resampled": bool(values["resampled"])}))  # type: ignore[arg-type]
