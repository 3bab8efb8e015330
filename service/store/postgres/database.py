"""A connection to the tables of a site, which is made again when it breaks."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from service.errors import JournalError, one_line
from service.pauses import GrowingPause
from service.store.postgres.driver import AGAIN, BROKEN, driver, is_one_of, sentence, state_of
from service.store.postgres.names import schema_of

STATEMENT_SECONDS = 30.0
"""A statement that takes longer is given up."""

FROZEN_SECONDS = 5.0
"""The server ends a transaction whose client stands still for so long: it would keep others from taking its lease."""

FIRST_PAUSE, LONGEST_PAUSE = 0.25, 8.0
"""Between two attempts to connect, in s; meanwhile everything fails at once."""

_ATTEMPTS = 4
_CONNECTION = {
    "application_name": "thermogate",
    "client_encoding": "utf8",
    "connect_timeout": 5,
    # A network that swallows packets is noticed within seconds, not hours.
    "keepalives_idle": 5,
    "keepalives_interval": 2,
    "keepalives_count": 3,
    "tcp_user_timeout": 10_000,
}
"""What a connection string does without, by libpq's names."""

Cursor = Any
"""A psycopg.Cursor, whose library is only imported where it is used."""

Result = TypeVar("Result")

_log = logging.getLogger(__name__)


class Database:
    """The tables of `site` in the database that `connection` names (libpq's key=value, or a URI).

    For one thread at a time. Everything may raise JournalError, and works again when the server does.
    """

    def __init__(self, connection: str, site: str) -> None:
        self._psycopg = driver()
        try:
            given = self._psycopg.conninfo.conninfo_to_dict(connection)
        except self._psycopg.Error as error:
            raise JournalError(
                f"the connection to PostgreSQL is not understood ({one_line(str(error).strip())}); write it as "
                "'host=db.example dbname=thermogate user=thermogate', or as a postgresql:// address"
            ) from error
        self._arguments = _CONNECTION | given
        self.schema = schema_of(site)
        where = f"{given.get('dbname', '(default)')} on {given.get('host', given.get('service', 'this machine'))}"
        self.place = f"{where}, schema {self.schema}"
        self.trouble: str | None = None
        """Why the last thing that was asked of it failed; None if it did not."""
        self.anew: Callable[[], None] = lambda: None
        """Called after every failed transaction: what is remembered of the tables may be wrong."""
        self._open: Any = None
        self._pause = GrowingPause(FIRST_PAUSE, LONGEST_PAUSE)
        self._not_before = 0.0

    def read(self, query: str, *values: object, **named: object) -> list[tuple[Any, ...]]:
        """All rows of a question with its values in their order, or by their names."""

        def ask(cursor: Cursor) -> list[tuple[Any, ...]]:
            found: list[tuple[Any, ...]] = cursor.execute(query, named or values).fetchall()
            return found

        return self._attempted(ask)

    def transaction(self, work: Callable[[Cursor], Result]) -> Result:
        """What `work` returns, with what it wrote durable.

        `work` may be called several times, the last time after a commit whose end is not known: it has to look what is
        there already.
        """

        def whole(cursor: Cursor) -> Result:
            with cursor.connection.transaction():
                return work(cursor)

        return self._attempted(whole)

    def close(self) -> None:
        """Close the connection; safe to call twice."""
        connection, self._open = self._open, None
        if connection is not None:
            with suppress(self._psycopg.Error):
                connection.close()

    def _attempted(self, work: Callable[[Cursor], Result]) -> Result:
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                with self._told(), self._connected().cursor(binary=True) as cursor:
                    result = work(cursor)
            except JournalError as error:
                self.anew()
                state = state_of(error.__cause__) if isinstance(error.__cause__, self._psycopg.Error) else ""
                if is_one_of(state, BROKEN) or self._open is None or self._open.closed:
                    # Where the server is back already, nobody has to hear of this.
                    tries_again = self._open is not None
                    self.close()
                else:
                    tries_again = is_one_of(state, AGAIN)
                if not tries_again or attempt == _ATTEMPTS:
                    raise
            else:
                if self.trouble is not None:
                    _log.info("the database %s works again", self.place)
                    self.trouble = None
                return result
        raise AssertionError("the last attempt returns or raises")

    def _connected(self) -> Any:
        """The connection, which is made if there is none."""
        if self._open is None:
            if time.monotonic() < self._not_before:
                raise JournalError(self.trouble or f"the database {self.place} failed")
            try:
                self._open = self._psycopg.connect(autocommit=True, **self._arguments)
                self._prepare(self._open)
            except self._psycopg.Error:
                self._not_before = time.monotonic() + self._pause.seconds
                self._pause.grow()
                self.close()
                raise
            self._pause.reset()
        return self._open

    def _prepare(self, connection: Any) -> None:
        connection.execute(
            "SELECT set_config('search_path', %s, false), set_config('statement_timeout', %s, false), "
            "set_config('idle_in_transaction_session_timeout', %s, false), "
            # What the server does beyond that, such as waiting for a standby, stays.
            "CASE WHEN current_setting('synchronous_commit') IN ('off', 'local') "
            "THEN set_config('synchronous_commit', 'on', false) END",
            (f'"{self.schema}"', f"{STATEMENT_SECONDS * 1000:.0f}", f"{FROZEN_SECONDS * 1000:.0f}"),
        )

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Turn psycopg's errors into one sentence with the place and the remedy."""
        try:
            yield
        except self._psycopg.Error as error:
            trouble = sentence(self.place, error)
            if self.trouble is None and not is_one_of(state_of(error), AGAIN):
                _log.warning("%s", trouble)
                self.trouble = trouble
            raise JournalError(trouble) from error
