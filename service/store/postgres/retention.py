"""What the database keeps: `keep_history` of every zone, within `max_journal` in all.

Rows go as in SQLite (`service.store.retention`), zone by zone, a day at least. A month that is empty then is dropped:
that gives the space back to the disk. Where there is too much, whole months go in which no zone needs anything.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator

from service.store.interface import DAY
from service.store.postgres import partitions
from service.store.postgres.database import Cursor
from service.store.postgres.journal import PostgresJournal
from service.store.postgres.partitions import Month
from service.store.postgres.schema import lock_of
from service.store.retention import Limits, Oldest, prune_old

_log = logging.getLogger(__name__)

_EARLIEST = -(2**62)
"""UTC s, before every sample."""

_NEEDED = f"""
SELECT number, newest, least(coalesce(oldest + 1, {_EARLIEST}), newest) AS needed FROM zones
CROSS JOIN LATERAL (SELECT time AS newest FROM samples WHERE zone = number ORDER BY time DESC LIMIT 1) AS last
CROSS JOIN LATERAL (SELECT min(step) AS oldest FROM checkpoints WHERE zone = number AND NOT damaged) AS first
WHERE position('@' in zones.zone) = 0
"""
"""Of every zone with samples the newest, and the time (UTC s) from which on a start may need them."""

_ASIDE = "SELECT number FROM zones WHERE position('@' in zone) > 0"


def prune(journal: PostgresJournal, oldest_checkpoint: Oldest, limits: Limits) -> Iterator[None]:
    """Delete what is beyond `limits`, a part of it at every step of the iterator; samples come in between."""
    yield from prune_old(journal, oldest_checkpoint, limits.keep_history, at_least=DAY)
    months = partitions.present(journal.database)
    newest = max((month.end for month in months), default=0)
    for month in months:
        if month.end <= newest - limits.keep_history:
            _drop(journal, month, f"SELECT EXISTS (SELECT FROM {month.name} WHERE zone NOT IN ({_ASIDE}))")
            yield
    if journal.size() > limits.max_journal:
        journal.database.transaction(_delete_aside)
        yield
    for month in partitions.present(journal.database):
        if journal.size() <= limits.max_journal:
            break
        until = "needed" if month.table == "samples" else "newest"
        _drop(
            journal,
            month,
            f"SELECT EXISTS (SELECT FROM ({_NEEDED}) AS bounds WHERE EXISTS "
            f"(SELECT FROM {month.name} AS old WHERE old.zone = number AND old.time >= {until}))",
        )
        yield


def _drop(journal: PostgresJournal, month: Month, stays: str) -> None:
    """Drop `month` unless the question `stays` finds anything in it that stays."""
    if journal.database.read(stays)[0][0]:
        return

    def work(cursor: Cursor) -> None:
        journal.fence.held(cursor)
        cursor.execute("SELECT pg_advisory_xact_lock(%s)", (lock_of(journal.database.schema),))
        cursor.execute("SET LOCAL lock_timeout = '2s'")
        cursor.execute(f"LOCK TABLE ONLY {month.table} IN ACCESS EXCLUSIVE MODE")
        if cursor.execute("SELECT to_regclass(%s) IS NULL", (month.name,)).fetchone()[0]:
            return
        # What came into it since cannot go.
        if cursor.execute(stays).fetchone()[0]:
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
    cursor.execute("DELETE FROM zones WHERE position('@' in zone) > 0")
