"""The months that the tables of samples and history are cut into: a month is dropped as a whole."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from service.store.postgres.database import Cursor, Database
from service.store.postgres.schema import lock_of

TABLES = ("samples", "history")

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class Month(NamedTuple):
    """The month of `table` that begins at `start` and ends before `end`, both UTC s."""

    table: str
    start: int
    end: int

    @property
    def name(self) -> str:
        """The name of its partition."""
        return f"{self.table}_{_EPOCH + timedelta(seconds=self.start):%Y_%m}"


def month_of(table: str, time: int) -> Month:
    """The month of `table` in which `time` (UTC s) is."""
    moment = _EPOCH + timedelta(seconds=time)
    start = moment.replace(day=1, hour=0, minute=0, second=0, microsecond=0)
    end = start.replace(year=start.year + start.month // 12, month=start.month % 12 + 1)
    return Month(table, _seconds(start), _seconds(end))


def make(cursor: Cursor, schema: str, months: Iterable[Month]) -> None:
    """Make sure that `months` are there, in a transaction on the tables in `schema`."""
    # Two shards may come to a new month at once.
    cursor.execute("SELECT pg_advisory_xact_lock(%s)", (lock_of(schema),))
    there = set(_present(cursor))
    for month in sorted(set(months) - there):
        # A table that is attached later keeps nobody from writing; one that is made as a partition does.
        cursor.execute(f"CREATE TABLE {month.name} (LIKE {month.table} INCLUDING ALL)")
        cursor.execute(
            f"ALTER TABLE {month.table} ATTACH PARTITION {month.name} FOR VALUES FROM ({month.start:d}) "
            f"TO ({month.end:d})"
        )


def present(database: Database) -> list[Month]:
    """The months that are there, oldest first."""
    return database.transaction(_present)


def _present(cursor: Cursor) -> list[Month]:
    names = cursor.execute(
        "SELECT parent.relname, child.relname FROM pg_inherits JOIN pg_class AS child ON child.oid = inhrelid "
        "JOIN pg_class AS parent ON parent.oid = inhparent WHERE parent.relkind = 'p' "
        "AND parent.relnamespace = current_schema()::regnamespace"
    ).fetchall()
    months = [_named(table, name) for table, name in names if table in TABLES]
    return sorted(months, key=lambda month: (month.start, month.table))


def _named(table: str, name: str) -> Month:
    year, month = name.removeprefix(f"{table}_").split("_")
    return month_of(table, _seconds(datetime(int(year), int(month), 1, tzinfo=UTC)))


def _seconds(moment: datetime) -> int:
    return round((moment - _EPOCH).total_seconds())
