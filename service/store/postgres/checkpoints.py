"""Checkpoints of a shard's zones in PostgreSQL: the same bytes as the files beside SQLite."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any

from service.errors import StateMismatch
from service.store.checkpoint import Checkpoint, Checkpoints, Found, encode, examined
from service.store.postgres.database import Cursor, Database
from service.store.postgres.fence import Fence, set_aside_as
from service.store.postgres.names import RESET

_OWN = "zone = (SELECT number FROM zones WHERE zone = %s) AND NOT damaged"

_log = logging.getLogger(__name__)


class PostgresCheckpoints(Checkpoints):
    """Checkpoints in `database`, the newest `keep` of each zone, written as far as `fence` lets it.

    It may be asked from any thread, one after the other. Every method may raise JournalError, and those that write
    Fenced.
    """

    def __init__(self, database: Database, fence: Fence, keep: int = 3) -> None:
        self._database = database
        self._fence = fence
        self._keep = keep
        self._one = threading.Lock()

    def save(self, zone: str, checkpoint: Checkpoint, *, keep_all: bool = False) -> None:
        """Write `checkpoint`, durable on return, and remove the oldest ones, unless to `keep_all`."""
        content = encode(checkpoint._replace(zone=zone))

        def work(cursor: Cursor) -> None:
            number = self._fence.required(cursor, [zone])[zone]
            cursor.execute(
                "INSERT INTO checkpoints (zone, step, content) VALUES (%s, %s, %b) ON CONFLICT (zone, step) "
                "DO UPDATE SET content = excluded.content, damaged = false",
                (number, checkpoint.step, content),
            )
            if not keep_all:
                cursor.execute(
                    "DELETE FROM checkpoints WHERE zone = %(zone)s AND NOT damaged AND step < (SELECT min(step) FROM "
                    "(SELECT step FROM checkpoints WHERE zone = %(zone)s AND NOT damaged ORDER BY step DESC "
                    "LIMIT %(keep)s) AS newest)",
                    {"zone": number, "keep": self._keep},
                )

        self._write(work)

    def found(self, zone: str) -> Iterator[Found]:
        """As all checkpoints are."""
        query = f"SELECT step, content FROM checkpoints WHERE {_OWN} AND step < %s ORDER BY step DESC LIMIT 1"
        before = 2**63 - 1
        while rows := self._read(query, zone, before):
            before, content = rows[0]
            yield examined(
                f"at {before} of zone '{zone}' in the database {self._database.place}", zone, before, content
            )

    def oldest(self, zone: str) -> int | None:
        """The step of the oldest kept checkpoint of `zone`; None if there is none."""
        step: int | None = self._read(f"SELECT min(step) FROM checkpoints WHERE {_OWN}", zone)[0][0]
        return step

    def reset(self, zone: str) -> None:
        """Nothing: the journal has set them aside with the zone."""

    def set_aside(self, zone: str, after: int) -> None:
        """Set those aside that were taken later than `after`."""

        def work(cursor: Cursor) -> None:
            number = self._fence.required(cursor, [zone])[zone]
            later = (number, after)
            if cursor.execute("SELECT 1 FROM checkpoints WHERE zone = %s AND step > %s", later).fetchone():
                aside = set_aside_as(cursor, zone)
                cursor.execute("UPDATE checkpoints SET zone = %s WHERE zone = %s AND step > %s", (aside, *later))

        self._write(work)

    def close(self) -> None:
        """Close the connection; safe to call twice."""
        with self._one:
            self._database.close()

    def _set_damaged_aside(self, zone: str, found: Found) -> None:
        _log.warning("the checkpoint %s is damaged (%s); using the one before", found.where, found.damage)

        def work(cursor: Cursor) -> None:
            number = self._fence.required(cursor, [zone])[zone]
            cursor.execute("UPDATE checkpoints SET damaged = true WHERE zone = %s AND step = %s", (number, found.step))

        self._write(work)

    def _mismatch(self, zone: str) -> StateMismatch:
        return StateMismatch(zone, f"the database {self._database.place}", RESET)

    def _read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        with self._one:
            return self._database.read(query, *values)

    def _write(self, work: Callable[[Cursor], None]) -> None:
        with self._one:
            self._database.transaction(work)
