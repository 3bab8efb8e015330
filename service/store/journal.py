"""The journal: every accepted sample, durable before it is assimilated, and the history that REST serves.

One SQLite file (WAL, synchronous=FULL) in the state directory. Samples are stored as little-endian float64 blobs, so a
replay sees the very bits that the worker saw, NaN included; history columns are plain numbers (NaN is NULL), so that
`sqlite3` on the command line can read them.
"""

from __future__ import annotations

import logging
import sqlite3
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adapters.reading import Reading
from service.errors import JournalError
from service.records.history import HISTORY_COLUMNS, HistoryRow
from service.records.sample import Sample
from service.records.update import Update
from service.store.journal_file import LOG_LIMIT, open_database, translated
from service.store.journal_rows import (
    HistoryReader,
    SampleRow,
    damaged_sample,
    history_row,
    linked_sample,
    reading_row,
    sample_row,
    to_reading,
)

__all__ = ["HistoryRow", "Journal"]

_BUSY_SECONDS = 5.0
_PAGE = 1000
_PENDING_LIMIT = 1000
_ROWS_AT_ONCE = 250
"""SQLite takes 32,766 values in a statement; the widest row has 22."""
_EARLIEST, _LATEST = -(2**63), 2**63 - 1

REMEMBERED = 3600
"""Readings are kept for so many s beyond the sample that they went into, to be known if they are posted again."""

SERIES_ROWS = 4000
"""Rows that a chart reads at once, before other work of the journal's thread has its turn."""

_COLUMNS = ", ".join(HISTORY_COLUMNS)
_RECORD = f"INSERT OR REPLACE INTO history (zone, {_COLUMNS}, checksum)"
_SAMPLE_COLUMNS = "zone, time, outputs, inputs, output_quality, input_quality, setpoint, link"

_READING_COLUMNS = "zone, time, channel, value, quality, checksum"

_log = logging.getLogger(__name__)


class Journal:
    """An open journal. Not for two threads at once; every method may raise JournalError."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        """The journal at `path` over a `connection`, which `open` makes; over one that only reads it is looked at."""
        self._connection = connection
        self._path = path
        self._pending: list[tuple[object, ...]] = []
        self._ends: dict[str, tuple[int, int]] = {}
        """Time and link of the newest sample of each zone that was written to since the journal was opened."""
        self._reader = HistoryReader(f"the journal {path}")
        self._keeping: set[str] = set()
        """The zones that have readings of their own here."""

    @classmethod
    def open(cls, path: Path) -> Journal:
        """Open the journal at `path`, creating it and its folder; refuses other files and newer schemas."""
        journal = cls(open_database(path, _BUSY_SECONDS), path)
        try:
            journal._keeping.update(zone for (zone,) in journal.read("SELECT DISTINCT zone FROM readings"))
        except JournalError:
            journal._connection.close()
            raise
        return journal

    def claim(self, zone: str, fingerprint: str) -> bool:
        """Whether the samples of `zone` belong to `fingerprint`; a zone without samples takes it over."""
        with self.transaction() as cursor:
            stored = cursor.execute("SELECT fingerprint FROM zones WHERE zone = ?", (zone,)).fetchone()
            used = cursor.execute("SELECT 1 FROM samples WHERE zone = ? LIMIT 1", (zone,)).fetchone()
            if stored is not None and used is not None:
                return bool(stored[0] == fingerprint)
            cursor.execute("INSERT OR REPLACE INTO zones VALUES (?, ?)", (zone, fingerprint))
            return True

    def append(self, zone: str, sample: Sample) -> bool:
        """Store `sample`, durable on return with the history recorded so far; False if it is not the newest."""
        return self.append_all([(zone, sample)]) == 1

    def append_all(self, accepted: Sequence[tuple[str, Sample]]) -> int:
        """Store samples of zones, all or none of them, as `append`; how many were not stored already."""
        rows: list[SampleRow] = []
        ends: dict[str, tuple[int, int]] = {}
        with self.transaction() as cursor:
            for zone, sample in accepted:
                time, link = ends.get(zone) or self._ends.get(zone) or self._end(zone)
                if sample.time > time:
                    rows.append(sample_row(zone, sample, link))
                    ends[zone] = (sample.time, rows[-1][-1])
            _insert(cursor, f"INSERT INTO samples ({_SAMPLE_COLUMNS})", rows)
            for zone in self._keeping & ends.keys():
                before = ends[zone][0] - REMEMBERED
                cursor.execute("DELETE FROM readings WHERE zone = ? AND time < ?", (zone, before))
        self._ends |= ends
        return len(rows)

    def keep(self, zone: str, readings: Sequence[Reading]) -> None:
        """Store usable readings of an interval that is open, durable on return; one that is there already stays."""
        self._keeping.add(zone)
        with self.transaction() as cursor:
            rows = [reading_row(zone, reading) for reading in readings]
            _insert(cursor, f"INSERT OR IGNORE INTO readings ({_READING_COLUMNS})", rows)

    def kept(self, zone: str, since: float, until: float = inf) -> list[Reading]:
        """The readings of `zone` that were kept, with `since` <= time <= `until` (UTC s), oldest first.

        A damaged one is left out, which the log says.
        """
        query = f"SELECT {_READING_COLUMNS} FROM readings WHERE zone = ? AND time BETWEEN ? AND ? ORDER BY time"
        found = []
        for row in self.read(query, zone, since, until) if zone in self._keeping else ():
            try:
                found.append(to_reading(row))
            except (ValueError, TypeError, AttributeError, struct.error) as error:
                _log.error("the journal %s holds a damaged reading of zone '%s' (%s)", self._path, zone, error)
        return found

    def record(self, zone: str, update: Update) -> None:
        """Add or replace the history row of `update`; durable with the next append, flush or close."""
        self._pending.append(history_row(zone, HistoryRow.of(update)))
        if len(self._pending) >= _PENDING_LIMIT:
            self.flush()

    def flush(self) -> None:
        """Make the recorded history durable."""
        if self._pending:
            with self.transaction():
                pass

    def skip(self, zone: str, time: int, reason: str) -> None:
        """Mark a stored sample as one that must not be assimilated; it stays in the file, with `reason`."""
        with self.transaction() as cursor:
            cursor.execute("UPDATE samples SET skipped = ? WHERE zone = ? AND time = ?", (reason, zone, time))
            if cursor.rowcount == 0:
                raise JournalError(f"the journal {self._path} has no sample of zone '{zone}' at {time} to skip")

    def samples_after(self, zone: str, time: int | None) -> Iterator[Sample]:
        """The samples of `zone` later than `time` (None: all), in order, without the skipped ones.

        A skipped sample is left out, as if its interval had brought nothing. Writing between two items is allowed.
        JournalError where a sample is damaged or missing in the middle.
        """
        after = _EARLIEST if time is None else time
        previous = self._link_before(zone, after)
        query = (
            f"SELECT {_SAMPLE_COLUMNS}, skipped FROM samples WHERE zone = ? AND time > ? ORDER BY time LIMIT {_PAGE}"
        )
        while True:
            with translated(self._path):
                rows = self._connection.execute(query, (zone, after)).fetchall()
            for *values, link, skipped in rows:
                try:
                    sample = linked_sample(tuple(values), link, previous or 0)
                except (ValueError, TypeError, AttributeError, struct.error) as error:
                    raise damaged_sample(f"the journal {self._path}", zone, values[1], error) from error
                if skipped is None:
                    yield sample
                previous = link
            if len(rows) < _PAGE:
                return
            after = rows[-1][1]

    def last_sample_time(self, zone: str) -> int | None:
        """Time of the newest stored sample of `zone`, skipped or not."""
        return self.sample_time_until(zone, _LATEST)

    def sample_time_until(self, zone: str, time: int) -> int | None:
        """As `last_sample_time`, of the samples up to `time`."""
        query = "SELECT max(time) FROM samples WHERE zone = ? AND time <= ?"
        newest: int | None = self.read(query, zone, time)[0][0]
        return newest

    def pruned_until(self, zone: str) -> int | None:
        """Time of the newest sample of `zone` that was deleted to keep the journal small; None if none was."""
        rows = self.read("SELECT time FROM pruned WHERE zone = ?", zone)
        return rows[0][0] if rows else None

    def history(self, zone: str, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (None: open), oldest first.

        A damaged row is left out, which the log says once.
        """
        self._show(zone)
        where, bounds = "zone = ?", [zone]
        for condition, bound in (("time >= ?", start), ("time < ?", end)):
            if bound is not None:
                where += f" AND {condition}"
                bounds.append(bound)  # type: ignore[arg-type]
        query = f"SELECT {_COLUMNS}, checksum FROM history WHERE {where} ORDER BY time DESC LIMIT ?"
        return self._reader.rows(zone, reversed(self.read(query, *bounds, limit)))

    def history_columns(
        self, zone: str, start: int, end: int, every: int
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64], int | None]:
        """History rows with `start` <= time < `end` at multiples of `every` s, oldest first: times (n,), and all
        columns (n, m), NaN where there is no value. Last comes where the next page begins; None: there is none.

        Damaged rows are left out, as in `history`.
        """
        self._show(zone)
        query = (
            f"SELECT {_COLUMNS}, checksum FROM history WHERE zone = ? AND time >= ? AND time < ? AND time % ? = 0 "
            "ORDER BY time LIMIT ?"
        )
        rows = self.read(query, zone, start, end, every, SERIES_ROWS)
        following = rows[-1][0] + 1 if len(rows) == SERIES_ROWS else None
        times, table = self._reader.table(zone, rows)
        return times, table, following

    def input_columns(
        self, zone: str, start: int, end: int, every: int, width: int
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64], int | None]:
        """The `width` inputs of accepted samples, as `history_columns`: times (n,), inputs (n, width), the next page.

        A damaged sample is left out as far as its length shows it: only a start, which assimilates, checks the chain.
        """
        query = (
            "SELECT time, inputs FROM samples WHERE zone = ? AND time >= ? AND time < ? AND time % ? = 0 "
            "ORDER BY time LIMIT ?"
        )
        rows = self.read(query, zone, start, end, every, SERIES_ROWS)
        following = rows[-1][0] + 1 if len(rows) == SERIES_ROWS else None
        whole = [(time, blob) for time, blob in rows if isinstance(blob, bytes) and len(blob) == 8 * width]
        times = np.array([time for time, _ in whole], dtype=np.int64)
        inputs = np.frombuffer(b"".join(blob for _, blob in whole), dtype="<f8").reshape(len(whole), width)
        return times, inputs.astype(np.float64), following

    def forget(self, zone: str) -> None:
        """Set aside all of `zone`: its rows stay in the file under a name that no zone can have.

        Until `forgot`, `is_forgotten` tells that what else there is of the zone has to go too.
        """
        aside = f"{zone}@{datetime.now(UTC).isoformat()}"
        with self.transaction() as cursor:
            for table in ("samples", "history", "zones", "pruned", "readings"):
                cursor.execute(f"UPDATE {table} SET zone = ? WHERE zone = ?", (aside, zone))
            cursor.execute("INSERT OR IGNORE INTO forgotten VALUES (?)", (zone,))
        self._ends.pop(zone, None)

    def is_forgotten(self, zone: str) -> bool:
        """Whether `zone` is being forgotten."""
        return bool(self.read("SELECT 1 FROM forgotten WHERE zone = ?", zone))

    def forgot(self, zone: str) -> None:
        """Nothing is left of `zone`."""
        with self.transaction() as cursor:
            cursor.execute("DELETE FROM forgotten WHERE zone = ?", (zone,))

    def size(self) -> int:
        """Bytes that the journal takes on the disk, with those that its write-ahead log is allowed."""
        return int(self.read("PRAGMA page_count")[0][0] * self.read("PRAGMA page_size")[0][0]) + LOG_LIMIT

    def shrink(self, pages: int) -> bool:
        """Give up to so many free pages back to the disk; whether that made them fewer."""
        free = self.read("PRAGMA freelist_count")
        with translated(self._path):
            # Of what it returns a page is freed at each step, and only a script takes all of them.
            self._connection.executescript(f"PRAGMA incremental_vacuum({pages:d})")
        return self.read("PRAGMA freelist_count") < free

    def samples_ahead(self, zone: str, after: int) -> int:
        """How many samples of `zone` are later than `after`."""
        count: int = self.read("SELECT count(*) FROM samples WHERE zone = ? AND time > ?", zone, after)[0][0]
        return count

    def set_aside(self, zone: str, after: int) -> None:
        """Set aside what is later than `after` of `zone`, as `forget` does with all of it."""
        aside = f"{zone}@{datetime.now(UTC).isoformat()}"
        with self.transaction() as cursor:
            for table in ("samples", "history", "readings"):
                cursor.execute(f"UPDATE {table} SET zone = ? WHERE zone = ? AND time > ?", (aside, zone, after))
        self._ends.pop(zone, None)

    def close(self) -> None:
        """Flush and close; safe to call twice."""
        try:
            self.flush()
        finally:
            self._connection.close()

    def read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        """All rows of a question."""
        with translated(self._path):
            return self._connection.execute(query, values).fetchall()

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Cursor]:
        """One durable transaction that also carries the pending history, which is kept for the next try if it fails."""
        with translated(self._path):
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

    def _show(self, zone: str) -> None:
        """Make durable what was recorded of `zone`, if it can be: what is there is read in any case."""
        # Reading need not wait for the disk because of other zones.
        if any(row[0] == zone for row in self._pending):
            with suppress(JournalError):
                self.flush()

    def _end(self, zone: str) -> tuple[int, int]:
        """Time and link of the newest sample of `zone`; without any, what the next one has to be chained to."""
        newest = self.read("SELECT time, link FROM samples WHERE zone = ? ORDER BY time DESC LIMIT 1", zone)
        time, link = newest[0] if newest else (_EARLIEST, self._link_before(zone, _EARLIEST))
        return time, link or 0

    def _link_before(self, zone: str, time: int) -> int | None:
        """The link of the newest sample not later than `time`, pruned or not; None where it has none."""
        query = "SELECT link FROM samples WHERE zone = ? AND time <= ? ORDER BY time DESC LIMIT 1"
        rows = self.read(query, zone, time) or self.read("SELECT link FROM pruned WHERE zone = ?", zone)
        return rows[0][0] if rows else None


def _insert(cursor: sqlite3.Cursor, statement: str, rows: Sequence[tuple[object, ...]]) -> None:
    """Insert `rows`.

    Many rows go into one statement: after every statement the interpreter lock has to be won back from threads that
    compute, which for a thousand zones would take longer than the writing.
    """
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        part = rows[first : first + _ROWS_AT_ONCE]
        places = ", ".join([f"({', '.join('?' * len(part[0]))})"] * len(part))
        cursor.execute(f"{statement} VALUES {places}", [value for row in part for value in row])
