"""The journal of a shard in PostgreSQL: the same rows, bits and checksums as in SQLite, written under a lease."""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from math import inf
from typing import Any, TypeVar

import numpy as np

from adapters.reading import Reading
from service.errors import Fenced, JournalError
from service.records.history import HISTORY_COLUMNS, HistoryRow
from service.records.sample import Sample
from service.records.update import Update
from service.store.interface import Columns
from service.store.journal import REMEMBERED, SERIES_ROWS
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
from service.store.postgres import partitions
from service.store.postgres.database import Cursor, Database
from service.store.postgres.fence import Fence, aside, set_aside_as
from service.store.postgres.names import RESET
from service.store.postgres.partitions import Month, month_of

_PAGE = 500
_PENDING_LIMIT = 1000
_EARLIEST = -(2**63)

_COLUMNS = ", ".join(HISTORY_COLUMNS)
_SAMPLE = "%s::text, time, outputs, inputs, output_quality, input_quality, setpoint"
_NUMBER = "zone = (SELECT number FROM zones WHERE zone = %s)"

_INSERT_SAMPLES = """
INSERT INTO samples (zone, time, outputs, inputs, output_quality, input_quality, setpoint, link) SELECT * FROM
unnest(%b::integer[], %b::bigint[], %b::bytea[], %b::bytea[], %b::text[], %b::text[], %b::float8[], %b::bigint[])
"""
_Column = tuple[str, Callable[[Any], object]]
"""The type of a column, and what makes a value of it."""
# NaN is NULL, as in SQLite: averages in SQL leave it out.
_NUMBER_OR_NULL: _Column = ("float8", lambda value: None if value != value else float(value))
_OTHERS: dict[str, _Column] = {"time": ("bigint", int), "resampled": ("boolean", bool), "segment": ("integer", int)}
_HISTORY: list[_Column] = [
    ("integer", int),
    *(_OTHERS.get(name, _NUMBER_OR_NULL) for name in HISTORY_COLUMNS),
    ("bigint", int),
]
_ARRAYS = ", ".join(f"%b::{kind}[]" for kind, _ in _HISTORY)
_REPLACED = ", ".join(f"{name} = excluded.{name}" for name in (*HISTORY_COLUMNS[1:], "checksum"))
_INSERT_HISTORY = f"""
INSERT INTO history (zone, {_COLUMNS}, checksum) SELECT * FROM unnest({_ARRAYS})
ON CONFLICT (zone, time) DO UPDATE SET {_REPLACED}
"""
_INSERT_READINGS = """
INSERT INTO readings (zone, time, channel, value, quality, checksum)
SELECT * FROM unnest(%b::integer[], %b::float8[], %b::text[], %b::float8[], %b::text[], %b::bigint[])
ON CONFLICT DO NOTHING
"""
_DELETE_READINGS = """
DELETE FROM readings USING unnest(%b::integer[], %b::float8[]) AS old (zone, before)
WHERE readings.zone = old.zone AND readings.time < old.before
"""

Result = TypeVar("Result")

_log = logging.getLogger(__name__)


class PostgresJournal:
    """The journal in `database`, written to as far as `fence` lets it. Not for two threads at once; every method may
    raise JournalError, and those that write Fenced."""

    def __init__(self, database: Database, fence: Fence) -> None:
        self.database = database
        self.fence = fence
        database.anew = self._anew
        self._place = f"the database {database.place}"
        self._pending: dict[tuple[str, int], tuple[Any, ...]] = {}
        """History rows that the next transaction takes along, by zone and time."""
        self._ends: dict[str, tuple[int, int]] = {}
        """Time and link of the newest sample of each zone that was written to."""
        self._months: set[Month] = set()
        """The months that are known to be there."""
        self._keeping: set[str] = set()
        """The zones that have readings of their own here."""
        self._reader = HistoryReader(self._place)

    def claim(self, zone: str, fingerprint: str) -> bool:
        """Take `zone` for the lease; whether its samples belong to `fingerprint`. One without samples takes it over.

        Fenced while another owner holds it.
        """

        def take(cursor: Cursor) -> None:
            number = self.fence.take(cursor, zone)
            query = "SELECT 1 FROM samples WHERE zone = %s LIMIT 1"
            if cursor.execute(query, (number,)).fetchone() is None:
                cursor.execute("UPDATE zones SET fingerprint = %s WHERE number = %s", (fingerprint, number))

        found = self._claimed(zone)
        if found is None or found[0] != fingerprint:
            self.database.transaction(take)
            found = self._claimed(zone)
        if found is None:
            return False
        stored, keeping = found
        if keeping:
            self._keeping.add(zone)
        return stored == fingerprint

    def take(self, zones: Collection[str]) -> None:
        """Take `zones` for the lease in one transaction, as far as nobody else holds them: `claim` is quicker then."""

        def work(cursor: Cursor) -> None:
            for zone in sorted(set(zones) - self.fence.keep(cursor, zones)):
                with suppress(Fenced):
                    self.fence.take(cursor, zone)
            # The lease itself may have been lost.
            self.fence.held(cursor)

        self.database.transaction(work)

    def give_up(self, zone: str) -> None:
        """Make durable what was recorded, and leave `zone` to whoever claims it next; nothing if it has gone."""

        def work(cursor: Cursor, held: dict[str, int]) -> None:
            query = "UPDATE zones SET lease = NULL WHERE zone = %s AND lease = %s AND epoch = %s"
            cursor.execute(query, (zone, self.fence.lease.name, self.fence.lease.epoch))

        self._write((), work)
        self._ends.pop(zone, None)
        self._keeping.discard(zone)

    def append_all(self, accepted: Sequence[tuple[str, Sample]]) -> int:
        """Store samples of zones, all or none of them, in the order of their times; how many were not stored already.

        Fenced, with their names, if some zones are another owner's.
        """

        def work(cursor: Cursor, held: dict[str, int]) -> tuple[int, dict[str, tuple[int, int]]]:
            rows: list[SampleRow] = []
            before = self._ends | _ends(cursor, held.keys() - self._ends.keys())
            ends: dict[str, tuple[int, int]] = {}
            for zone, sample in accepted:
                time, link = ends.get(zone) or before[zone]
                if sample.time > time:
                    rows.append(sample_row(zone, sample, link))
                    ends[zone] = (sample.time, rows[-1][-1])
            if rows:
                zones, *columns, setpoints, links = (list(column) for column in zip(*rows, strict=True))
                setpoints = [None if value is None else float(value) for value in setpoints]
                cursor.execute(_INSERT_SAMPLES, [[held[zone] for zone in zones], *columns, setpoints, links])
            keeping = sorted(self._keeping & ends.keys())
            if keeping:
                old = [float(ends[zone][0] - REMEMBERED) for zone in keeping]
                cursor.execute(_DELETE_READINGS, [[held[zone] for zone in keeping], old])
            return len(rows), ends

        months = {month_of("samples", sample.time) for _, sample in accepted}
        stored, ends = self._write({zone for zone, _ in accepted}, work, months)
        self._ends |= ends
        return stored

    def keep(self, zone: str, readings: Sequence[Reading]) -> None:
        """Store usable readings of an interval that is open, durable on return; one that is there already stays."""
        self._keeping.add(zone)

        def work(cursor: Cursor, held: dict[str, int]) -> None:
            if rows := [reading_row(zone, reading)[1:] for reading in readings]:
                times, channels, values, *others = (list(column) for column in zip(*rows, strict=True))
                numbers = [list(map(float, times)), channels, list(map(float, values))]
                cursor.execute(_INSERT_READINGS, [[held[zone]] * len(rows), *numbers, *others])

        self._write([zone], work)

    def kept(self, zone: str, since: float, until: float = inf) -> list[Reading]:
        """The readings of `zone` that were kept, with `since` <= time <= `until` (UTC s), oldest first.

        A damaged one is left out, which the log says.
        """
        query = (
            f"SELECT %s::text, time, channel, value, quality, checksum FROM readings WHERE {_NUMBER} "
            "AND time BETWEEN %s AND %s ORDER BY time, channel"
        )
        rows = self.database.read(query, zone, zone, float(since), float(until)) if zone in self._keeping else []
        found = []
        for row in rows:
            try:
                found.append(to_reading(row))
            except (ValueError, struct.error) as error:
                _log.error("%s holds a damaged reading of zone '%s' (%s)", self._place, zone, error)
        return found

    def record(self, zone: str, update: Update) -> None:
        """Add or replace the history row of `update`; durable with the next append, flush or close."""
        self._pending[zone, update.time] = history_row(zone, HistoryRow.of(update))
        if len(self._pending) >= _PENDING_LIMIT:
            self.flush()

    def flush(self) -> None:
        """Make the recorded history durable."""
        if self._pending:
            self._write((), lambda cursor, held: None)

    def skip(self, zone: str, time: int, reason: str) -> None:
        """Mark a stored sample as one that must not be assimilated; it stays in its table, with `reason`."""

        def work(cursor: Cursor, held: dict[str, int]) -> None:
            query = "UPDATE samples SET skipped = %s WHERE zone = %s AND time = %s"
            cursor.execute(query, (reason.replace("\0", ""), held[zone], time))
            if cursor.rowcount == 0:
                raise JournalError(f"{self._place} has no sample of zone '{zone}' at {time} to skip")

        self._write([zone], work)

    def samples_after(self, zone: str, time: int | None) -> Iterator[Sample]:
        """The samples of `zone` later than `time` (None: all), in order, without the skipped ones.

        Writing between two items is allowed. JournalError where a sample is damaged or missing in the middle.
        """
        after = _EARLIEST if time is None else time
        query = (
            f"SELECT {_SAMPLE}, link, skipped FROM samples WHERE {_NUMBER} AND time > %s ORDER BY time LIMIT {_PAGE}"
        )
        rows = self.database.read(query, zone, zone, after)
        previous = self._link_before(zone, after) if rows else 0
        while True:
            for *values, link, skipped in rows:
                try:
                    sample = linked_sample(tuple(values), link, previous)
                except (ValueError, TypeError, struct.error) as error:
                    raise damaged_sample(self._place, zone, values[1], error, RESET) from error
                if skipped is None:
                    yield sample
                previous = link
            if len(rows) < _PAGE:
                return
            after = rows[-1][1]
            rows = self.database.read(query, zone, zone, after)

    def last_sample_time(self, zone: str) -> int | None:
        """Time of the newest stored sample of `zone`, skipped or not."""
        newest = self.database.read(f"SELECT time FROM samples WHERE {_NUMBER} ORDER BY time DESC LIMIT 1", zone)
        return newest[0][0] if newest else None

    def pruned_until(self, zone: str) -> int | None:
        """Time of the newest sample of `zone` that was deleted to keep the tables small; None if none was."""
        rows = self.database.read("SELECT pruned FROM zones WHERE zone = %s", zone)
        return rows[0][0] if rows else None

    def history(self, zone: str, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (None: open), oldest first.

        A damaged row is left out, which the log says once.
        """
        self._show(zone)
        bounds = [("time >= %s", start), ("time < %s", end)]
        where = " AND ".join([_NUMBER, *(condition for condition, bound in bounds if bound is not None)])
        query = f"SELECT {_COLUMNS}, checksum FROM history WHERE {where} ORDER BY time DESC LIMIT %s"
        rows = self.database.read(query, zone, *(bound for _, bound in bounds if bound is not None), limit)
        return self._reader.rows(zone, reversed(rows))

    def history_columns(self, zone: str, start: int, end: int, every: int) -> Columns:
        """A page of history rows with `start` <= time < `end` at multiples of `every` s, all columns (n, m).

        Damaged rows are left out, as in `history`.
        """
        self._show(zone)
        query = (
            f"SELECT {_COLUMNS}, checksum FROM history WHERE {_NUMBER} AND time >= %s AND time < %s "
            "AND time %% %s = 0 ORDER BY time LIMIT %s"
        )
        rows = self.database.read(query, zone, start, end, every, SERIES_ROWS)
        times, table = self._reader.table(zone, rows)
        return times, table, rows[-1][0] + 1 if len(rows) == SERIES_ROWS else None

    def input_columns(self, zone: str, start: int, end: int, every: int, width: int) -> Columns:
        """The `width` inputs of accepted samples, as `history_columns`."""
        query = (
            f"SELECT time, inputs FROM samples WHERE {_NUMBER} AND time >= %s AND time < %s AND time %% %s = 0 "
            f"AND length(inputs) = {8 * width:d} ORDER BY time LIMIT %s"
        )
        rows = self.database.read(query, zone, start, end, every, SERIES_ROWS)
        times = np.array([time for time, _ in rows], dtype=np.int64)
        inputs = np.frombuffer(b"".join(blob for _, blob in rows), dtype="<f8").reshape(len(rows), width)
        return times, inputs.astype(np.float64), rows[-1][0] + 1 if len(rows) == SERIES_ROWS else None

    def forget(self, zone: str) -> None:
        """Set aside all of `zone`, checkpoints included, under a name that no zone can have; it stays this owner's."""

        def work(cursor: Cursor) -> None:
            number = self.fence.take(cursor, zone)
            cursor.execute("UPDATE zones SET zone = %s, lease = NULL WHERE number = %s", (aside(zone), number))
            self.fence.take(cursor, zone)

        self._pending = {key: row for key, row in self._pending.items() if key[0] != zone}
        self._keeping.discard(zone)
        self._ends.pop(zone, None)
        self.database.transaction(work)

    def is_forgotten(self, zone: str) -> bool:
        """False: a zone is forgotten whole or not at all."""
        return False

    def forgot(self, zone: str) -> None:
        """Nothing is left to do."""

    def samples_ahead(self, zone: str, after: int) -> int:
        """How many samples of `zone` are later than `after`."""
        query = f"SELECT count(*) FROM samples WHERE {_NUMBER} AND time > %s"
        return int(self.database.read(query, zone, after)[0][0])

    def set_aside(self, zone: str, after: int) -> None:
        """Set aside what is later than `after` of `zone`, as `forget` does with all of it."""

        def work(cursor: Cursor, held: dict[str, int]) -> None:
            number = set_aside_as(cursor, zone)
            for table in ("samples", "history", "readings"):
                query = f"UPDATE {table} SET zone = %s WHERE zone = %s AND time > %s"
                cursor.execute(query, (number, held[zone], after))

        self._write([zone], work)
        self._ends.pop(zone, None)

    def look(self) -> None:
        """Raises if nothing can be written now: Fenced if the lease is lost."""
        self.database.transaction(self.fence.held)

    def size(self) -> int:
        """Bytes that samples, history and readings of all zones of the site take on the disk, with their indexes."""
        query = (
            "SELECT coalesce(sum(pg_total_relation_size(oid)), 0)::bigint FROM pg_class WHERE relkind = 'r' "
            "AND relnamespace = current_schema()::regnamespace AND relname <> 'checkpoints'"
        )
        return int(self.database.read(query)[0][0])

    def close(self) -> None:
        """Flush and close; safe to call twice. What was recorded for another owner is left out: he has it too."""
        try:
            self.flush()
        except Fenced:
            self._pending.clear()
        finally:
            self.database.close()

    def _write(
        self,
        zones: Collection[str],
        work: Callable[[Cursor, dict[str, int]], Result],
        months: Collection[Month] = (),
    ) -> Result:
        """The result of `work(cursor, held)` in one durable transaction that also carries the pending history, which is
        kept for the next try if it fails. `held` are the numbers of `zones`, which have to be this owner's; `months`
        have to be there."""
        pending = dict(self._pending)
        wanted = {*months, *(month_of("history", time) for _, time in pending)}
        schema = self.database.schema
        if new := wanted - self._months:
            self.database.transaction(lambda cursor: partitions.make(cursor, schema, new))
            self._months |= new

        def whole(cursor: Cursor) -> Result:
            if forgotten := wanted - self._months:
                # An attempt has failed, perhaps because another shard has dropped one of them.
                partitions.make(cursor, schema, forgotten)
            held = self.fence.required(cursor, zones, {zone for zone, _ in pending})
            # A zone that has gone to another owner has the same history there.
            rows = [(held[zone], *row[1:]) for (zone, _), row in pending.items() if zone in held]
            if rows:
                columns = zip(_HISTORY, zip(*rows, strict=True), strict=True)
                cursor.execute(_INSERT_HISTORY, [[cast(value) for value in column] for (_, cast), column in columns])
            return work(cursor, held)

        result = self.database.transaction(whole)
        self._months |= wanted
        self._pending.clear()
        return result

    def _claimed(self, zone: str) -> tuple[str | None, bool] | None:
        """What the samples of `zone` belong to, and whether readings of it are kept; None unless the lease holds it."""
        query = (
            "SELECT fingerprint, EXISTS (SELECT FROM readings WHERE readings.zone = number) FROM zones "
            "WHERE zone = %s AND lease = %s AND epoch = %s"
        )
        rows = self.database.read(query, zone, self.fence.lease.name, self.fence.lease.epoch)
        return rows[0] if rows else None

    def _link_before(self, zone: str, time: int) -> int:
        """The link of the newest sample not later than `time`, pruned or not; 0 without any."""
        query = f"SELECT link FROM samples WHERE {_NUMBER} AND time <= %s ORDER BY time DESC LIMIT 1"
        rows = self.database.read(query, zone, time) or self.database.read(
            "SELECT coalesce(pruned_link, 0) FROM zones WHERE zone = %s", zone
        )
        return int(rows[0][0]) if rows else 0

    def _show(self, zone: str) -> None:
        """Make durable what was recorded of `zone`, if it can be: what is there is read in any case."""
        if any(owner == zone for owner, _ in self._pending):
            with suppress(JournalError):
                self.flush()

    def _anew(self) -> None:
        self._ends.clear()
        self._months.clear()


def _ends(cursor: Cursor, zones: Collection[str]) -> dict[str, tuple[int, int]]:
    """Time and link of the newest sample of each zone; without any, what the next one has to be chained to."""
    if not zones:
        return {}
    rows = cursor.execute(
        "SELECT zones.zone, coalesce(newest.time, %s), coalesce(newest.link, pruned_link, 0) FROM zones "
        "LEFT JOIN LATERAL (SELECT time, link FROM samples WHERE zone = number ORDER BY time DESC LIMIT 1) AS newest "
        "ON true WHERE zones.zone = ANY(%b::text[])",
        (_EARLIEST, sorted(zones)),
    ).fetchall()
    return {zone: (time, link) for zone, time, link in rows}
