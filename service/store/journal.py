"""The journal: every accepted sample, durable before it is assimilated, and the history that REST serves, in SQLite or
PostgreSQL. Samples are little-endian float64 blobs, so that a replay sees the very bits that the worker saw, NaN
included; history columns are plain numbers (NaN is NULL) for `sqlite3` on the command line."""

import logging
import struct
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Any, Self

import numpy as np

from adapters.reading import Reading
from estimator.arrays import Array, Indices
from service.errors import Fenced, JournalError, reset_by_run
from service.records.history import HISTORY_COLUMNS, HistoryRow
from service.records.sample import Sample
from service.records.update import Update
from service.store.database import Cursor, Database, Result
from service.store.journal_file import JournalFile
from service.store.journal_rows import (
    HistoryReader,
    SampleRow,
    history_row,
    linked_sample,
    reading_row,
    sample_row,
    to_reading,
)

REMEMBERED = 3600
"""Readings are kept for so many s beyond the sample that they went into, to be known if they are posted again."""
SERIES_ROWS = 4000
"""Rows that a chart reads at once, before other work of the journal's thread has its turn."""
PAGE = 500
"""Samples that are read at once."""
DELETED_AT_ONCE = 500
"""Rows of a table that are deleted in a transaction."""
_EARLIEST = -(2**63)
"""Not later than any sample."""
ROWS = ("samples", "history", "readings")
"""The tables with rows of zones at times."""

Columns = tuple[Indices, Array, int | None]
"""Times [UTC s] (n,), values (n, m), and where the next page begins; None: there is none."""

_COLUMNS = ", ".join(HISTORY_COLUMNS)
_SAMPLES = "samples (zone, time, outputs, inputs, output_quality, input_quality, setpoint, link)"
_HISTORY = f"history (zone, {_COLUMNS}, checksum)"
_REPLACED = ", ".join(f"{name} = excluded.{name}" for name in (*HISTORY_COLUMNS[1:], "checksum"))
_REPLACE = f"ON CONFLICT (zone, time) DO UPDATE SET {_REPLACED}"
_READINGS = "readings (zone, time, channel, value, quality, checksum)"
_CHART = "WHERE zone = ? AND time >= ? AND time < ? AND time % ? = 0 ORDER BY time LIMIT ?"
"""Those rows of a chart that are at multiples of so many s."""
# With IN instead, SQLite would read all samples.
_FINGERPRINTS = (
    "SELECT zone, fingerprint FROM zones WHERE EXISTS (SELECT 1 FROM samples WHERE samples.zone = zones.zone)"
)

_log = logging.getLogger(__name__)


class Journal:
    """The journal in a `database`: blocking, and but for `record` for one thread at a time. Every method may raise
    JournalError, and those that write Fenced for a zone that is another owner's."""

    def __init__(self, database: Database) -> None:
        self.database = database
        self.read = database.read
        self._pending: dict[tuple[str, int], Update] = {}
        """What the next transaction adds to the history, by zone and time."""
        self._recording = threading.Lock()
        self._ends: dict[str, tuple[int, int]] = {}
        """Time and link of the newest sample of each zone that was written to since the journal was opened."""
        self._keeping: set[str] = set()
        """The zones that have readings of their own here."""
        self._reader = HistoryReader(database.place)

    @classmethod
    def open(cls, path: Path) -> Self:
        """The journal in the SQLite file at `path`, made with its folder; other files and schemas are refused."""
        return cls(JournalFile.open(path))

    def claim(self, zone: str, fingerprint: str) -> bool:
        """Whether the samples of `zone` belong to `fingerprint`; a zone without samples takes it over."""

        def work(cursor: Cursor) -> tuple[bool, bool]:
            self.database.take(cursor, zone)
            kept = cursor.execute("SELECT 1 FROM readings WHERE zone = ? LIMIT 1", zone).fetchone() is not None
            stored = cursor.execute("SELECT fingerprint FROM zones WHERE zone = ?", zone).fetchone()
            used = cursor.execute("SELECT 1 FROM samples WHERE zone = ? LIMIT 1", zone).fetchone()
            if stored is not None and used is not None:
                return bool(stored[0] == fingerprint), kept
            replace = "ON CONFLICT (zone) DO UPDATE SET fingerprint = excluded.fingerprint"
            cursor.insert("zones (zone, fingerprint)", [(zone, fingerprint)], replace)
            return True, kept

        self._ends.pop(zone, None)
        belongs, keeps = self._write((), work)
        if keeps:
            self._keeping.add(zone)
        return belongs

    def append_all(
        self, accepted: Sequence[tuple[str, Sample]], kept: Sequence[tuple[str, Sequence[Reading]]] = ()
    ) -> int:
        """Store samples of zones, and usable readings of intervals that are open (one that is there already stays), all
        or none of them, durable on return with the history recorded so far; how many samples were newer than all of
        their zone. Fenced, with their names, for zones that are another owner's."""
        self._keeping.update(zone for zone, _ in kept)

        def work(cursor: Cursor) -> tuple[int, dict[str, tuple[int, int]]]:
            # Another attempt looks what is there.
            known, self._ends = self._ends, {}
            rows: list[SampleRow] = []
            ends: dict[str, tuple[int, int]] = {}
            for zone, sample in accepted:
                time, link = ends.get(zone) or known.get(zone) or _end(cursor, zone)
                if sample.time > time:
                    rows.append(sample_row(zone, sample, link))
                    ends[zone] = (sample.time, rows[-1][-1])
            cursor.insert(_SAMPLES, rows)
            for zone in self._keeping & ends.keys():
                before = ends[zone][0] - REMEMBERED
                cursor.execute("DELETE FROM readings WHERE zone = ? AND time < ?", zone, before)
            told = [reading_row(zone, reading) for zone, readings in kept for reading in readings]
            cursor.insert(_READINGS, told, "ON CONFLICT DO NOTHING")
            return len(rows), known | ends

        stored, self._ends = self._write({zone for zone, _ in (*accepted, *kept)}, work)
        return stored

    def record(self, zone: str, update: Update) -> None:
        """Add or replace the history row of `update`; durable with the next append, flush or close. From any thread."""
        with self._recording:
            self._pending[zone, update.time] = update

    def flush(self) -> None:
        """Make the recorded history durable. Raises if nothing can be written now, also where there is none."""
        self._write((), lambda cursor: None)

    def kept(self, zone: str, since: float, until: float = inf) -> list[Reading]:
        """The readings of `zone` with `since` <= time <= `until` (UTC s), oldest first, but for damaged ones."""
        query = (
            "SELECT zone, time, channel, value, quality, checksum FROM readings "
            "WHERE zone = ? AND time BETWEEN ? AND ? ORDER BY time, channel"
        )
        found = []
        for row in self.read(query, zone, float(since), float(until)):
            try:
                found.append(to_reading(row))
            except (ValueError, TypeError, AttributeError, struct.error) as error:
                _log.error("%s holds a damaged reading of zone '%s' (%s)", self.database.place, zone, error)
        return found

    def skip(self, zone: str, time: int, reason: str) -> None:
        """Mark a stored sample as one that must not be assimilated; it stays where it is, with `reason`."""

        def work(cursor: Cursor) -> None:
            query = "UPDATE samples SET skipped = ? WHERE zone = ? AND time = ?"
            if cursor.execute(query, reason.replace("\0", ""), zone, time).rowcount == 0:
                raise JournalError(f"{self.database.place} has no sample of zone '{zone}' at {time} to skip")

        self._write([zone], work)

    def forget(self, zone: str) -> None:
        """Set aside all of `zone` under a name that no zone can have.

        Until `forgot`, `is_forgotten` tells that what else there is of the zone has to go too.
        """

        def work(cursor: Cursor) -> None:
            aside = _aside(zone)
            self.database.take(cursor, zone)
            copy = "INSERT INTO zones (zone, fingerprint) SELECT ?, fingerprint FROM zones WHERE zone = ?"
            cursor.execute(copy, aside, zone)
            for table in (*ROWS, "pruned"):
                cursor.execute(f"UPDATE {table} SET zone = ? WHERE zone = ?", aside, zone)  # noqa: S608
            cursor.insert("forgotten (zone)", [(zone,)], "ON CONFLICT DO NOTHING")

        self._write((), work)
        self._ends.pop(zone, None)

    def is_forgotten(self, zone: str) -> bool:
        return bool(self.read("SELECT 1 FROM forgotten WHERE zone = ?", zone))

    def forgot(self, zone: str) -> None:
        self._write([zone], lambda cursor: cursor.execute("DELETE FROM forgotten WHERE zone = ?", zone))

    def give_up(self, zone: str) -> None:
        """Make durable what was recorded, and leave `zone` to its next owner."""
        self._write((), lambda cursor: self.database.give_up(cursor, zone))
        self._ends.pop(zone, None)
        self._keeping.discard(zone)

    def set_aside(self, zone: str, after: int) -> None:
        """Set aside what is later than `after` of `zone`, as `forget` does with all of it."""
        aside = _aside(zone)

        def work(cursor: Cursor) -> None:
            for table in ROWS:
                cursor.execute(f"UPDATE {table} SET zone = ? WHERE zone = ? AND time > ?", aside, zone, after)  # noqa: S608

        self._write([zone], work)
        self._ends.pop(zone, None)

    def prunable(self) -> list[str]:
        """The zones of which rows may be deleted here, without what was set aside."""
        self.flush()
        own = self.database.own_zones()
        return [zone for zone in self.every_zone() if not is_aside(zone)] if own is None else own

    def every_zone(self) -> list[str]:
        """Every zone there are rows of, what was set aside among them, from one seek each."""
        found: set[str] = set()
        for table in ROWS:
            last = ""
            while rows := self.read(f"SELECT zone FROM {table} WHERE zone > ? ORDER BY zone LIMIT 1", last):  # noqa: S608
                last = rows[0][0]
                found.add(last)
        return sorted(found)

    def delete(self, zone: str, samples_before: int, history_before: int) -> bool:
        """Delete the oldest rows of `zone` before these times, a slice of each table; whether there were any. Of what
        was set aside the readings go as well, as far as the samples."""
        bounds = {"samples": samples_before, "history": history_before}
        if is_aside(zone):
            bounds["readings"] = samples_before

        def work(cursor: Cursor) -> bool:
            found = False
            for table in ROWS:
                link = ", link" if table == "samples" else ""
                oldest = f"SELECT time{link} FROM {table} WHERE zone = ? AND time < ? ORDER BY time LIMIT ?"  # noqa: S608
                before = bounds.get(table, _EARLIEST)
                if rows := cursor.execute(oldest, zone, before, DELETED_AT_ONCE).fetchall():
                    found = True
                    cursor.execute(f"DELETE FROM {table} WHERE zone = ? AND time <= ?", zone, rows[-1][0])  # noqa: S608
                if rows and table == "samples":
                    # The next sample is checked against the link of the one before it.
                    replace = "ON CONFLICT (zone) DO UPDATE SET time = excluded.time, link = excluded.link"
                    cursor.insert("pruned (zone, time, link)", [(zone, *rows[-1])], replace)
            return found

        return self._write([zone], work)

    def close(self) -> None:
        """Flush and close; safe to call twice. What was recorded for another owner is left out: he has it too."""
        try:
            if self._pending:
                with suppress(Fenced):
                    self.flush()
        finally:
            self._pending.clear()
            self.database.close()

    def samples_after(self, zone: str, time: int | None) -> Iterator[Sample]:
        """The samples of `zone` later than `time` (None: all), in order, without the skipped ones. Writing between two
        items is allowed. JournalError where a sample is damaged or missing in the middle."""
        after = _EARLIEST if time is None else time
        query = (
            "SELECT time, outputs, inputs, output_quality, input_quality, setpoint, link, skipped FROM samples "  # noqa: S608
            f"WHERE zone = ? AND time > ? ORDER BY time LIMIT {PAGE}"
        )
        rows = self.read(query, zone, after)
        previous = self._link_before(zone, after) if rows else 0
        while True:
            for *values, link, skipped in rows:
                try:
                    sample = linked_sample((zone, *values), link, previous)
                except (ValueError, TypeError, AttributeError, struct.error) as error:
                    reset = self.database.reset or reset_by_run(zone)
                    raise JournalError(
                        f"{self.database.place} holds a damaged sample of zone '{zone}' at {values[0]} ({error}); "
                        f"check the disk, then restore a backup, or give the zone's state up {reset}"
                    ) from error
                if skipped is None:
                    yield sample
                previous = link
            if len(rows) < PAGE:
                return
            after = rows[-1][0]
            rows = self.read(query, zone, after)

    def fingerprints(self) -> dict[str, str]:
        """What the samples of every zone that has any belong to, by its id."""
        return dict(self.read(_FINGERPRINTS))

    def last_sample_time(self, zone: str) -> int | None:
        """Time of the newest stored sample of `zone`, skipped or not."""
        return self.sample_time_until(zone, 2**62)

    def sample_time_until(self, zone: str, time: int) -> int | None:
        """Time of the newest stored sample of `zone` up to `time`, skipped or not."""
        return self.read("SELECT max(time) FROM samples WHERE zone = ? AND time <= ?", zone, time)[0][0]

    def first_time(self, table: str, zone: str) -> int | None:
        """Time of the oldest row of `zone` in a table."""
        return self.read(f"SELECT min(time) FROM {table} WHERE zone = ?", zone)[0][0]  # noqa: S608

    def samples_ahead(self, zone: str, after: int) -> int:
        """How many samples of `zone` are later than `after`."""
        return int(self.read("SELECT count(*) FROM samples WHERE zone = ? AND time > ?", zone, after)[0][0])

    def pruned_until(self, zone: str) -> int | None:
        """Time of the newest sample of `zone` that was deleted to keep the journal small; None if none was."""
        rows = self.read("SELECT time FROM pruned WHERE zone = ?", zone)
        return rows[0][0] if rows else None

    def history(self, zone: str, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (None: open), oldest first.

        A damaged row is left out, which the log says once.
        """
        self._show(zone)
        bounds = (_EARLIEST if start is None else start, 2**62 if end is None else end)
        query = (
            f"SELECT {_COLUMNS}, checksum FROM history WHERE zone = ? AND time >= ? AND time < ? "  # noqa: S608
            "ORDER BY time DESC LIMIT ?"
        )
        return self._reader.rows(zone, reversed(self.read(query, zone, *bounds, limit)))

    def history_columns(self, zone: str, start: int, end: int, every: int) -> Columns:
        """A page of history rows with `start` <= time < `end` at multiples of `every` s, all columns (n, m), NaN where
        there is no value. Damaged rows are left out, as in `history`."""
        self._show(zone)
        rows, following = self._page(f"SELECT {_COLUMNS}, checksum FROM history {_CHART}", zone, start, end, every)  # noqa: S608
        return *self._reader.table(zone, rows), following

    def input_columns(self, zone: str, start: int, end: int, every: int, width: int) -> Columns:
        """The same for the `width` inputs of accepted samples; of these a start alone checks the chain."""
        rows, following = self._page(f"SELECT time, inputs FROM samples {_CHART}", zone, start, end, every)  # noqa: S608
        whole = [(time, blob) for time, blob in rows if isinstance(blob, bytes) and len(blob) == 8 * width]
        times = np.array([time for time, _ in whole], dtype=np.int64)
        inputs = np.frombuffer(b"".join(blob for _, blob in whole), dtype="<f8").reshape(len(whole), width)
        return times, inputs.astype(np.float64), following

    def _page(
        self, query: str, zone: str, start: int, end: int, every: int
    ) -> tuple[list[tuple[Any, ...]], int | None]:
        """The next rows of a chart that `query` reads, the time of each first, and where the page after them begins."""
        rows = self.read(query, zone, start, end, every, SERIES_ROWS)
        return rows, rows[-1][0] + 1 if len(rows) == SERIES_ROWS else None

    def _show(self, zone: str) -> None:
        """Make durable what was recorded of `zone`, if it can be: what is there is read in any case."""
        with self._recording:
            recorded = any(owner == zone for owner, _ in self._pending)
        # Reading need not wait for the disk because of other zones.
        if recorded:
            with suppress(JournalError):
                self.flush()

    def _link_before(self, zone: str, time: int) -> int:
        """The link of the newest sample not later than `time`, pruned or not; 0 without any."""
        query = "SELECT link FROM samples WHERE zone = ? AND time <= ? ORDER BY time DESC LIMIT 1"
        rows = self.read(query, zone, time) or self.read("SELECT link FROM pruned WHERE zone = ?", zone)
        return rows[0][0] or 0 if rows else 0

    def _write(self, zones: Collection[str], work: Callable[[Cursor], Result]) -> Result:
        """The result of `work` in one durable transaction that writes to `zones` and also carries the pending history,
        which is kept for the next try if it fails."""
        with self._recording:
            pending = dict(self._pending)

        def whole(cursor: Cursor) -> Result:
            own = self.database.writable(cursor, zones, {zone for zone, _ in pending})
            rows = [history_row(zone, HistoryRow.of(update)) for (zone, _), update in pending.items() if zone in own]
            cursor.insert(_HISTORY, rows, _REPLACE)
            return work(cursor)

        result = self.database.transaction(whole)
        with self._recording:
            for key, update in pending.items():
                # It may have been replaced meanwhile.
                if self._pending.get(key) is update:
                    del self._pending[key]
        return result


def is_aside(zone: str) -> bool:
    """Whether this names what was set aside of a zone; no id has this sign."""
    return "@" in zone


def _aside(zone: str) -> str:
    return f"{zone}@{datetime.now(UTC).isoformat()}"


def _end(cursor: Cursor, zone: str) -> tuple[int, int]:
    """Time and link of the newest sample of `zone`; without any, what the next one has to be chained to."""
    query = "SELECT time, link FROM samples WHERE zone = ? ORDER BY time DESC LIMIT 1"
    newest = cursor.execute(query, zone).fetchone()
    if newest is None:
        pruned = cursor.execute("SELECT link FROM pruned WHERE zone = ?", zone).fetchone()
        newest = _EARLIEST, pruned and pruned[0]
    return newest[0], newest[1] or 0
