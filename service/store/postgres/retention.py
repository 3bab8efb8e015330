"""What the database keeps: `keep_history` of every zone, within `max_journal` in all.

Rows go as in SQLite (`service.store.retention`), zone by zone, a day at least and a week at most, from the zones of the
own lease. A month goes as a whole once no zone has anything in it that stays, nor more than a week that goes for its
age: that gives the space back to the disk.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator

from adapters.fields.times import written_time
from service.store.postgres import partitions
from service.store.postgres.database import Cursor
from service.store.postgres.journal import PostgresJournal
from service.store.postgres.partitions import Month
from service.store.postgres.schema import lock_of
from service.store.retention import DAY, HOUR, LEAP, MOST_AT_ONCE, STEADY_HOURS, Limits, tell_deleted

_log = logging.getLogger(__name__)

_ROWS_AT_ONCE = 5000
_ALWAYS = -(2**62)
"""Earlier than every sample."""

_BOUNDS = f"""
SELECT zone, number, newest, before, least(before, coalesce(oldest + 1, {_ALWAYS}), newest) AS needed
FROM zones
CROSS JOIN LATERAL (SELECT time AS newest FROM samples WHERE zone = number ORDER BY time DESC LIMIT 1) AS last
CROSS JOIN LATERAL (SELECT min(step) AS oldest FROM checkpoints WHERE zone = number AND NOT damaged) AS first
CROSS JOIN LATERAL (
    WITH RECURSIVE hop(time, span, count) AS (
        SELECT newest, 0::bigint, 0
        UNION ALL
        SELECT earlier.time, hop.time - earlier.time, count + 1 FROM hop CROSS JOIN LATERAL (
            SELECT time FROM samples WHERE zone = number AND time <= hop.time - {HOUR} ORDER BY time DESC LIMIT 1
        ) AS earlier WHERE count < {STEADY_HOURS}
    )
    SELECT CASE WHEN max(span) <= %(leap)s OR %(keep)s = 0 THEN ceil(newest - %(keep)s)::bigint ELSE {_ALWAYS} END
        AS before FROM hop
) AS age
WHERE zones.zone NOT LIKE '%%@%%'
"""
"""Of every zone with samples, up to when (UTC s) its history and its samples may go; nothing after a leap in time, as
`service.store.retention` says. With `keep` 0 the clock does not matter."""

_FIRST = {
    table: f"SELECT time FROM {table} WHERE zone = %(zone)s AND time < %(before)s ORDER BY time LIMIT 1"
    for table in ("samples", "history")
}
_LAST = {
    table: f"SELECT max(time) FROM (SELECT time FROM {table} WHERE zone = %(zone)s AND time < %(before)s "
    f"ORDER BY time LIMIT {_ROWS_AT_ONCE}) AS slice"
    for table in ("samples", "history")
}
_PRUNED = """
UPDATE zones SET pruned = samples.time, pruned_link = samples.link FROM samples
WHERE number = %(zone)s AND samples.zone = %(zone)s AND samples.time = %(last)s
"""
_ASIDE = "SELECT number FROM zones WHERE zone LIKE '%@%'"


def prune(journal: PostgresJournal, limits: Limits) -> Iterator[None]:
    """Delete what is beyond `limits`, a part of it at every step of the iterator; samples come in between."""
    lease = journal.fence.lease
    query = f"{_BOUNDS} AND lease = %(name)s AND epoch = %(epoch)s"
    told: list[str] = []
    for zone, number, _, before, needed in journal.database.read(
        query, keep=float(limits.keep_history), leap=LEAP, name=lease.name, epoch=lease.epoch
    ):
        firsts = [journal.database.read(_FIRST[table], zone=number, before=before) for table in ("samples", "history")]
        samples, history = (min(before, rows[0][0] + MOST_AT_ONCE) if rows else before for rows in firsts)
        while _delete(journal, zone, min(samples, needed), history):
            yield
        if firsts[1] and history - firsts[1][0][0] > DAY:
            told.append(f"'{zone}' from {written_time(firsts[1][0][0])} to {written_time(history)}")
        yield
    tell_deleted(told)
    months = partitions.present(journal.database)
    newest = max((month.end for month in months), default=0)
    for month in months:
        if month.end <= newest - limits.keep_history:
            _drop(journal, month, limits.keep_history, MOST_AT_ONCE)
            yield
    if journal.size() > limits.max_journal:
        journal.database.transaction(_delete_aside)
        yield
    for month in months:
        if journal.size() <= limits.max_journal:
            break
        _drop(journal, month, 0.0, -_ALWAYS)
        yield


def _delete(journal: PostgresJournal, zone: str, samples_before: int, history_before: int) -> bool:
    """Delete the oldest rows of `zone` before these times if they are of more than a day; whether more are left."""

    def work(cursor: Cursor) -> bool:
        number = journal.fence.required(cursor, [zone])[zone]
        deleted = [_delete_of(cursor, "samples", number, samples_before)]
        deleted += [_delete_of(cursor, "history", number, history_before)]
        return max(deleted) >= _ROWS_AT_ONCE

    return journal.database.transaction(work)


def _delete_of(cursor: Cursor, table: str, number: int, before: int) -> int:
    """Delete the oldest rows of a zone before that time, a slice of them, once there is a day of them: one statement
    for many rows. How many went."""
    values = {"zone": number, "before": before}
    first = cursor.execute(_FIRST[table], values).fetchone()
    if first is None or first[0] > before - DAY:
        return 0
    values["last"] = cursor.execute(_LAST[table], values).fetchone()[0]
    if table == "samples":
        # The next sample is checked against the link of the one before it.
        cursor.execute(_PRUNED, values)
    cursor.execute(f"DELETE FROM {table} WHERE zone = %(zone)s AND time <= %(last)s", values)
    return int(cursor.rowcount)


def _drop(journal: PostgresJournal, month: Month, keep: float, most: int) -> None:
    """Drop `month` if no zone has anything in it that stays, where it keeps its last `keep` s, nor more than `most`
    s."""
    until = "needed" if month.table == "samples" else "before"
    stays = (
        f"SELECT EXISTS (SELECT 1 FROM ({_BOUNDS}) AS bounds WHERE EXISTS "
        f"(SELECT 1 FROM {month.name} AS old WHERE old.zone = number AND old.time >= least({until}, "
        f"(SELECT min(time) FROM {month.name} AS first WHERE first.zone = number) + %(most)s)))"
    )
    values = {"keep": float(keep), "leap": LEAP, "most": most}
    if journal.database.read(stays, **values)[0][0]:
        return

    def work(cursor: Cursor) -> None:
        journal.fence.held(cursor)
        cursor.execute("SELECT pg_advisory_xact_lock(%s)", (lock_of(journal.database.schema),))
        cursor.execute("SET LOCAL lock_timeout = '2s'")
        cursor.execute(f"LOCK TABLE ONLY {month.table} IN ACCESS EXCLUSIVE MODE")
        if cursor.execute("SELECT to_regclass(%s) IS NULL", (month.name,)).fetchone()[0]:
            return
        # What came into it since cannot go.
        if cursor.execute(stays, values).fetchone()[0]:
            return
        if month.table == "samples":
            cursor.execute(
                f"UPDATE zones SET pruned = last.time, pruned_link = last.link FROM (SELECT DISTINCT ON (zone) zone, "
                f"time, link FROM {month.name} ORDER BY zone, time DESC) AS last "
                "WHERE number = last.zone AND coalesce(pruned < last.time, true)"
            )
        cursor.execute(f"DROP TABLE {month.name}")
        _log.info(
            "the table %s is dropped: no zone has anything in it that keep_history and max_journal let stay", month.name
        )

    journal.database.transaction(work)
    # Whoever writes into it again makes it anew.
    journal.database.anew()


def _delete_aside(cursor: Cursor) -> None:
    """Delete what was set aside."""
    for table in ("samples", "history", "readings", "checkpoints"):
        cursor.execute(f"DELETE FROM {table} WHERE zone IN ({_ASIDE})")
    cursor.execute("DELETE FROM zones WHERE zone LIKE '%@%'")
