"""Checkpoints of a shard's zones in PostgreSQL: the same bytes as the files beside SQLite."""

import logging
import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import Any

from service.errors import StateMismatch
from service.store.checkpoint import BEGINNING, KEPT, Checkpoint, Checkpoints, Found, encode, examined
from service.store.database import Cursor
from service.store.postgres.database import PostgresDatabase

_log = logging.getLogger(__name__)


class PostgresCheckpoints(Checkpoints):
    """Checkpoints in `database`. It may be asked from any thread, one after the other. Every method may raise
    JournalError, and those that write Fenced."""

    def __init__(self, database: PostgresDatabase) -> None:
        self._database = database
        self._one = threading.Lock()

    def save(self, zone: str, checkpoint: Checkpoint, *, keep_all: bool = False) -> None:
        content = encode(checkpoint._replace(zone=zone))

        def work(cursor: Cursor) -> None:
            replace = "ON CONFLICT (zone, step) DO UPDATE SET content = excluded.content, damaged = false"
            cursor.insert("checkpoints (zone, step, content)", [(zone, checkpoint.step, content)], replace)
            if not keep_all:
                cursor.execute(
                    "DELETE FROM checkpoints WHERE zone = ? AND NOT damaged AND step < (SELECT min(step) FROM "
                    "(SELECT step FROM checkpoints WHERE zone = ? AND NOT damaged ORDER BY step DESC LIMIT ?) AS kept)",
                    zone,
                    zone,
                    KEPT,
                )

        self._write(zone, work)

    def found(self, zone: str) -> Iterator[Found]:
        query = (
            "SELECT step, content FROM checkpoints WHERE zone = ? AND NOT damaged AND step < ? "
            "ORDER BY step DESC LIMIT 1"
        )
        before = 2**63 - 1
        while rows := self._read(query, zone, before):
            before, content = rows[0]
            yield examined(f"at {before} of zone '{zone}' in {self._database.place}", zone, before, content)

    def oldest(self, zone: str) -> int | None:
        query = "SELECT min(step) FROM checkpoints WHERE zone = ? AND NOT damaged"
        return self._read(query, zone)[0][0]

    def set_aside(self, zone: str, after: int = BEGINNING - 1) -> None:
        aside = f"{zone}@{datetime.now(UTC).isoformat()}"
        query = "UPDATE checkpoints SET zone = ? WHERE zone = ? AND step > ?"
        self._write(zone, lambda cursor: cursor.execute(query, aside, zone, after))

    def close(self) -> None:
        """Close the connection; safe to call twice."""
        with self._one:
            self._database.close()

    def _set_damaged_aside(self, zone: str, found: Found) -> None:
        _log.warning("the checkpoint %s is damaged (%s); using the one before", found.where, found.damage)
        query = "UPDATE checkpoints SET damaged = true WHERE zone = ? AND step = ?"
        self._write(zone, lambda cursor: cursor.execute(query, zone, found.step))

    def _mismatch(self, zone: str) -> StateMismatch:
        return StateMismatch(zone, self._database.place, self._database.reset)

    def _read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        with self._one:
            return self._database.read(query, *values)

    def _write(self, zone: str, work: Callable[[Cursor], object]) -> None:
        def whole(cursor: Cursor) -> None:
            self._database.writable(cursor, [zone], ())
            work(cursor)

        with self._one:
            self._database.transaction(whole)
