"""The journal of a shard in PostgreSQL: the same rows, bits and checksums as in SQLite, written under a lease."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any, TypeVar

from adapters.reading import Reading
from service.errors import Fenced, JournalError
from service.records.history import HISTORY_COLUMNS
from service.records.sample import Sample
from service.store.interface import DAY, EARLIEST, REMEMBERED, SampleJournal
from service.store.journal_rows import SampleRow, reading_row, sample_row
from service.store.postgres import partitions
from service.store.postgres.database import Cursor, Database
from service.store.postgres.fence import Fence, aside, set_aside_as
from service.store.postgres.names import RESET
from service.store.postgres.partitions import Month, month_of

_COLUMNS = ", ".join(HISTORY_COLUMNS)

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

_PRUNABLE = """
SELECT zone FROM zones WHERE position('@' in zone) = 0 AND (lease = %(name)s AND epoch = %(epoch)s OR lease IS NULL AND
%(name)s = (SELECT min(name) FROM leases WHERE owner IS NOT NULL AND expires > clock_timestamp())) ORDER BY zone
"""
_DELETED_AT_ONCE = 5000
_PRUNED = """
UPDATE zones SET pruned = samples.time, pruned_link = samples.link FROM samples
WHERE number = %(zone)s AND samples.zone = %(zone)s AND samples.time = %(last)s
"""

Result = TypeVar("Result")


class PostgresJournal(SampleJournal):
    """The journal in `database`, written to as far as `fence` lets it: methods that write may raise Fenced."""

    _FINGERPRINTS = "SELECT zone, fingerprint FROM zones WHERE EXISTS (SELECT 1 FROM samples WHERE zone = number)"

    def __init__(self, database: Database, fence: Fence) -> None:
        super().__init__(f"the database {database.place}", RESET)
        self.database = database
        self.fence = fence
        database.anew = self._anew
        self._months: set[Month] = set()
        """The months that are known to be there."""

    def read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        return self.database.read(_in_postgres(query), *values)

    def claim(self, zone: str, fingerprint: str) -> bool:
        """As every journal; takes `zone` for the lease. Fenced while another owner holds it."""

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
        self._keeping.add(zone)

        def work(cursor: Cursor, held: dict[str, int]) -> None:
            if rows := [reading_row(zone, reading)[1:] for reading in readings]:
                times, channels, values, *others = (list(column) for column in zip(*rows, strict=True))
                numbers = [list(map(float, times)), channels, list(map(float, values))]
                cursor.execute(_INSERT_READINGS, [[held[zone]] * len(rows), *numbers, *others])

        self._write([zone], work)

    def flush(self) -> None:
        if self._pending:
            self._write((), lambda cursor, held: None)

    def skip(self, zone: str, time: int, reason: str) -> None:
        def work(cursor: Cursor, held: dict[str, int]) -> None:
            query = "UPDATE samples SET skipped = %s WHERE zone = %s AND time = %s"
            cursor.execute(query, (reason.replace("\0", ""), held[zone], time))
            if cursor.rowcount == 0:
                raise JournalError(f"{self._place} has no sample of zone '{zone}' at {time} to skip")

        self._write([zone], work)

    def pruned_until(self, zone: str) -> int | None:
        rows = self.database.read("SELECT pruned FROM zones WHERE zone = %s", zone)
        return rows[0][0] if rows else None

    def pruned_link(self, zone: str) -> int:
        rows = self.database.read("SELECT coalesce(pruned_link, 0) FROM zones WHERE zone = %s", zone)
        return int(rows[0][0]) if rows else 0

    def forget(self, zone: str) -> None:
        """As every journal, checkpoints included; `zone` stays this owner's."""

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
        """Nothing is left to do then."""

    def set_aside(self, zone: str, after: int) -> None:
        def work(cursor: Cursor, held: dict[str, int]) -> None:
            number = set_aside_as(cursor, zone)
            for table in ("samples", "history", "readings"):
                query = f"UPDATE {table} SET zone = %s WHERE zone = %s AND time > %s"
                cursor.execute(query, (number, held[zone], after))

        self._write([zone], work)
        self._ends.pop(zone, None)

    def prunable(self) -> list[str]:
        """As every journal: the zones of the lease, and of the first lease of all also those that nobody has."""

        def work(cursor: Cursor) -> list[str]:
            self.fence.held(cursor)
            lease = self.fence.lease
            rows = cursor.execute(_PRUNABLE, {"name": lease.name, "epoch": lease.epoch}).fetchall()
            return [zone for (zone,) in rows]

        return self.database.transaction(work)

    def delete(self, zone: str, samples_before: int, history_before: int) -> bool:
        """As every journal, once there is a day of them: one statement for many rows."""

        def work(cursor: Cursor) -> bool:
            number = self.fence.held(cursor, [zone]).get(zone)
            if number is None:
                # While this holds the row of a zone that nobody has, nobody takes it.
                free = "SELECT number FROM zones WHERE zone = %s AND lease IS NULL FOR UPDATE"
                row = cursor.execute(free, (zone,)).fetchone()
                number = self.fence.required(cursor, [zone])[zone] if row is None else row[0]
            deleted = [_delete_of(cursor, "samples", number, samples_before)]
            deleted += [_delete_of(cursor, "history", number, history_before)]
            return max(deleted) >= _DELETED_AT_ONCE

        return self.database.transaction(work)

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
        """As every journal. What was recorded for another owner is left out: he has it too."""
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
        (EARLIEST, sorted(zones)),
    ).fetchall()
    return {zone: (time, link) for zone, time, link in rows}


def _delete_of(cursor: Cursor, table: str, number: int, before: int) -> int:
    """Delete the oldest rows of a zone before that time, a slice, once there is a day of them; how many went."""
    values = {"zone": number, "before": before}
    oldest = f"SELECT min(time) FROM {table} WHERE zone = %(zone)s AND time < %(before)s"
    first = cursor.execute(oldest, values).fetchone()[0]
    if first is None or first > before - DAY:
        return 0
    slice_ = (
        f"SELECT max(time) FROM (SELECT time FROM {table} WHERE zone = %(zone)s AND time < %(before)s "
        f"ORDER BY time LIMIT {_DELETED_AT_ONCE}) AS slice"
    )
    values["last"] = cursor.execute(slice_, values).fetchone()[0]
    if table == "samples":
        # The next sample is checked against the link of the one before it.
        cursor.execute(_PRUNED, values)
    cursor.execute(f"DELETE FROM {table} WHERE zone = %(zone)s AND time <= %(last)s", values)
    return int(cursor.rowcount)


@lru_cache(maxsize=64)
def _in_postgres(query: str) -> str:
    """A question in SQLite's words in those of psycopg, for tables that have a zone's number and not its id."""
    by_number = "zone = (SELECT number FROM zones WHERE zone = ?)"
    return query.replace("%", "%%").replace("zone = ?", by_number).replace("?", "%s")
