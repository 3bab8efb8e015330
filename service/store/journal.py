"""The journal: every accepted sample, durable before it is assimilated, and the history that REST serves.

One SQLite file (WAL, synchronous=FULL) in the state directory. Samples are stored as little-endian float64 blobs, so a
replay sees the very bits that the worker saw, NaN included; history columns are plain numbers (NaN is NULL), so that
`sqlite3` on the command line can read them.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from adapters.reading import Reading
from service.errors import JournalError
from service.records.history import HISTORY_COLUMNS
from service.records.sample import Sample
from service.store.interface import EARLIEST, REMEMBERED, SampleJournal
from service.store.journal_file import LOG_LIMIT, open_database, translated
from service.store.journal_rows import SampleRow, reading_row, sample_row

_BUSY_SECONDS = 5.0
_ROWS_AT_ONCE = 250
"""SQLite takes 32,766 values in a statement; the widest row has 22."""
_COLUMNS = ", ".join(HISTORY_COLUMNS)
_RECORD = f"INSERT OR REPLACE INTO history (zone, {_COLUMNS}, checksum)"
_SAMPLE_COLUMNS = "zone, time, outputs, inputs, output_quality, input_quality, setpoint, link"

_READING_COLUMNS = "zone, time, channel, value, quality, checksum"
_DELETED_AT_ONCE = 500

_OLDEST = {
    "samples": "SELECT time, link FROM samples WHERE zone = ? AND time < ? ORDER BY time LIMIT ?",
    "history": "SELECT time, zone FROM history WHERE zone = ? AND time < ? ORDER BY time LIMIT ?",
    "readings": "SELECT time, channel FROM readings WHERE zone = ? AND time < ? ORDER BY time LIMIT ?",
}
"""Asks for the oldest rows of a zone, by the name of their table."""


class Journal(SampleJournal):
    """An open journal."""

    # With IN instead, SQLite would read all samples.
    _FINGERPRINTS = (
        "SELECT zone, fingerprint FROM zones WHERE EXISTS (SELECT 1 FROM samples WHERE samples.zone = zones.zone)"
    )

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        """The journal at `path` over a `connection`, which `open` makes; over one that only reads it is looked at."""
        super().__init__(f"the journal {path}")
        self._connection = connection
        self._path = path

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
        self._keeping.add(zone)
        with self.transaction() as cursor:
            rows = [reading_row(zone, reading) for reading in readings]
            _insert(cursor, f"INSERT OR IGNORE INTO readings ({_READING_COLUMNS})", rows)

    def flush(self) -> None:
        if self._pending:
            with self.transaction():
                pass

    def skip(self, zone: str, time: int, reason: str) -> None:
        with self.transaction() as cursor:
            cursor.execute("UPDATE samples SET skipped = ? WHERE zone = ? AND time = ?", (reason, zone, time))
            if cursor.rowcount == 0:
                raise JournalError(f"the journal {self._path} has no sample of zone '{zone}' at {time} to skip")

    def pruned_until(self, zone: str) -> int | None:
        rows = self.read("SELECT time FROM pruned WHERE zone = ?", zone)
        return rows[0][0] if rows else None

    def pruned_link(self, zone: str) -> int:
        rows = self.read("SELECT link FROM pruned WHERE zone = ?", zone)
        return rows[0][0] or 0 if rows else 0

    def forget(self, zone: str) -> None:
        aside = f"{zone}@{datetime.now(UTC).isoformat()}"
        with self.transaction() as cursor:
            for table in ("samples", "history", "zones", "pruned", "readings"):
                cursor.execute(f"UPDATE {table} SET zone = ? WHERE zone = ?", (aside, zone))
            cursor.execute("INSERT OR IGNORE INTO forgotten VALUES (?)", (zone,))
        self._ends.pop(zone, None)

    def is_forgotten(self, zone: str) -> bool:
        return bool(self.read("SELECT 1 FROM forgotten WHERE zone = ?", zone))

    def forgot(self, zone: str) -> None:
        with self.transaction() as cursor:
            cursor.execute("DELETE FROM forgotten WHERE zone = ?", (zone,))

    def prunable(self) -> list[str]:
        return [zone for zone in self.every_zone() if not is_aside(zone)]

    def every_zone(self) -> list[str]:
        """Every zone there are rows of, what was set aside among them, from one seek each."""
        found: set[str] = set()
        for table in ("samples", "history", "readings"):
            last = ""
            while rows := self.read(f"SELECT zone FROM {table} WHERE zone > ? ORDER BY zone LIMIT 1", last):
                last = rows[0][0]
                found.add(last)
        return sorted(found)

    def delete(self, zone: str, samples_before: int, history_before: int) -> bool:
        """As every journal; of what was set aside the readings as well, as far as the samples."""
        bounds = {"samples": samples_before, "history": history_before}
        if is_aside(zone):
            bounds["readings"] = samples_before
        last = {
            name: rows[-1]
            for name, before in bounds.items()
            if (rows := self.read(_OLDEST[name], zone, before, _DELETED_AT_ONCE))
        }
        if not last:
            return False
        with self.transaction() as cursor:
            for table in ("samples", "history", "readings"):
                if table in last:
                    cursor.execute(f"DELETE FROM {table} WHERE zone = ? AND time <= ?", (zone, last[table][0]))
            if "samples" in last:
                # The next sample is checked against the link of the one before it.
                cursor.execute("INSERT OR REPLACE INTO pruned VALUES (?, ?, ?)", (zone, *last["samples"]))
        return True

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

    def set_aside(self, zone: str, after: int) -> None:
        aside = f"{zone}@{datetime.now(UTC).isoformat()}"
        with self.transaction() as cursor:
            for table in ("samples", "history", "readings"):
                cursor.execute(f"UPDATE {table} SET zone = ? WHERE zone = ? AND time > ?", (aside, zone, after))
        self._ends.pop(zone, None)

    def close(self) -> None:
        try:
            self.flush()
        finally:
            self._connection.close()

    def read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        with translated(self._path):
            return self._connection.execute(query, values).fetchall()

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Cursor]:
        """One durable transaction that also carries the pending history, which is kept for the next try if it fails."""
        with translated(self._path):
            cursor = self._connection.cursor()
            try:
                cursor.execute("BEGIN IMMEDIATE")
                _insert(cursor, _RECORD, list(self._pending.values()))
                yield cursor
                cursor.execute("COMMIT")
            except BaseException:
                # A full disk makes SQLite roll back by itself.
                if self._connection.in_transaction:
                    cursor.execute("ROLLBACK")
                raise
        self._pending.clear()

    def _end(self, zone: str) -> tuple[int, int]:
        """Time and link of the newest sample of `zone`; without any, what the next one has to be chained to."""
        newest = self.read("SELECT time, link FROM samples WHERE zone = ? ORDER BY time DESC LIMIT 1", zone)
        time, link = newest[0] if newest else (EARLIEST, self.pruned_link(zone))
        return time, link or 0


def is_aside(zone: str) -> bool:
    """Whether this names what was set aside of a zone; no id has this sign."""
    return "@" in zone


def _insert(cursor: sqlite3.Cursor, statement: str, rows: Sequence[tuple[object, ...]]) -> None:
    """Insert `rows`.

    Many rows go into one statement: after every statement the interpreter lock has to be won back from threads that
    compute, which for a thousand zones would take longer than the writing.
    """
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        part = rows[first : first + _ROWS_AT_ONCE]
        places = ", ".join([f"({', '.join('?' * len(part[0]))})"] * len(part))
        cursor.execute(f"{statement} VALUES {places}", [value for row in part for value in row])
