"""A connection to the tables of a site, made again when it breaks, and the errors of PostgreSQL in sentences."""

import logging
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from types import ModuleType
from typing import Any

from service.errors import JournalError, one_line
from service.pauses import GrowingPause
from service.store.database import Cursor, Database, Result

STATEMENT_SECONDS = 30.0
"""A statement that takes longer is given up."""
FROZEN_SECONDS = 5.0
"""The server ends a transaction whose client stands still for so long: it would keep others from taking its lease."""
FIRST_PAUSE, LONGEST_PAUSE = 0.25, 8.0
"""Between two attempts to connect, in s; meanwhile everything fails at once."""
_ATTEMPTS = 4
_LONGEST = 63
"""Bytes that PostgreSQL takes of a name; the rest it leaves out in silence."""
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
_PLACE = "free space on the disk of the server, or give it more; the rows of reset zones and old history may go"
_REMEDIES = {
    "08": "start it, see why the network between here and there fails, or correct host, dbname, user and password",
    "25006": "it is a standby or was made read-only; name the primary, or add target_session_attrs=read-write",
    "25P03": "this process stood still inside a transaction, which is tried again",
    "40": "several owners wrote at once, and it is tried again",
    "42501": "let the user create and write tables: GRANT CREATE ON DATABASE, or make it their owner",
    "42P01": "its tables are incomplete; restore a backup, or drop the schema to begin anew",
    "53100": _PLACE,
    "53200": "the server has run out of memory; see its work_mem and max_connections",
    "53300": "raise max_connections of the server, each shard holds three connections",
    "53": "give the server more of what it lacks",
    "55P03": "another session holds a lock on it; see pg_stat_activity",
    "57014": "it took longer than statement_timeout; see in pg_stat_activity what keeps the server busy",
    "57P": "wait until it has started again",
    "58": "see the log of the server, which cannot use its disk",
    "XX": "look in the log of the server whether its disk has failed, and restore a backup (docs/operations.md)",
}
"""By SQLSTATE or the beginning of one, the longest first that fits."""
_BROKEN = ("08", "25006", "25P03", "57P")
"""SQLSTATEs after which the connection is made anew. After a change of the primary it leads to another server."""
_AGAIN = ("40001", "40P01", "23505")
"""SQLSTATEs after which a transaction is tried again.

Beside conflicts: a row that is there already is one of an earlier attempt whose end was not known, or of an owner that
is fenced meanwhile.
"""
_SIZE = (
    "SELECT coalesce(sum(pg_total_relation_size(oid)), 0)::bigint FROM pg_class WHERE relkind = 'r' "
    "AND relnamespace = current_schema()::regnamespace AND relname <> 'checkpoints'"
)

_log = logging.getLogger(__name__)


def driver() -> ModuleType:
    """psycopg; JournalError that says how to install it where it is missing."""
    try:
        import psycopg
        import psycopg.conninfo
    except ImportError as error:
        raise JournalError(
            f"PostgreSQL needs psycopg ({one_line(str(error))}); install it with: pip install 'thermogate[fleet]'"
        ) from error
    return psycopg


def schema_of(site: str) -> str:
    """The schema that holds the tables of `site`."""
    name = f"thermogate_{site}"
    if len(name.encode()) <= _LONGEST:
        return name
    return f"{name[: _LONGEST - 9]}_{zlib.crc32(site.encode()):08x}"


class PostgresDatabase(Database):
    """The tables of `site` in the database that `connection` names (libpq's key=value, or a URI), connected anew when
    the server is back."""

    reset = "as docs/operations.md tells under 'A site in PostgreSQL', by SQL"
    least_pruned = 86_400
    """A day: one statement for many rows."""

    def __init__(self, connection: str, site: str, *, read_only: bool = False) -> None:
        self._psycopg = driver()
        self._read_only = read_only
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
        self.place = f"the database {where}, schema {self.schema}"
        self.trouble: str | None = None
        """Why the last thing that was asked of it failed; None if it did not."""
        self._open: Any = None
        self._pause = GrowingPause(FIRST_PAUSE, LONGEST_PAUSE)
        self._not_before = 0.0

    def read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        return self._attempted(lambda cursor: list(_Cursor(cursor).execute(query, *values).fetchall()))

    def transaction(self, work: Callable[[Cursor], Result]) -> Result:
        def whole(cursor: Any) -> Result:
            with cursor.connection.transaction():
                return work(_Cursor(cursor))

        return self._attempted(whole)

    def size(self) -> int:
        """Bytes that samples, history and readings of all zones of the site take on the disk, with their indexes."""
        return int(self.read(_SIZE)[0][0])

    def close(self) -> None:
        connection, self._open = self._open, None
        if connection is not None:
            with suppress(self._psycopg.Error):
                connection.close()

    def _attempted(self, work: Callable[[Any], Result]) -> Result:
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                with self._told(), self._connected().cursor(binary=True) as cursor:
                    result = work(cursor)
            except JournalError as error:
                state = _state_of(error.__cause__) if isinstance(error.__cause__, self._psycopg.Error) else ""
                if state.startswith(_BROKEN) or self._open is None or self._open.closed:
                    # Where the server is back already, nobody has to hear of this.
                    tries_again = self._open is not None
                    self.close()
                else:
                    tries_again = state.startswith(_AGAIN)
                if not tries_again or attempt == _ATTEMPTS:
                    raise
            else:
                if self.trouble is not None:
                    _log.info("%s works again", self.place)
                    self.trouble = None
                return result
        raise AssertionError("the last attempt returns or raises")

    def _connected(self) -> Any:
        if self._open is None:
            if time.monotonic() < self._not_before:
                raise JournalError(self.trouble or f"{self.place} failed")
            settings = {
                "search_path": f'"{self.schema}"',
                "statement_timeout": f"{STATEMENT_SECONDS * 1000:.0f}",
                "idle_in_transaction_session_timeout": f"{FROZEN_SECONDS * 1000:.0f}",
            }
            if self._read_only:
                settings["default_transaction_read_only"] = "on"
            try:
                self._open = self._psycopg.connect(autocommit=True, **self._arguments)
                self._open.execute(
                    "SELECT set_config(name, value, false) FROM unnest(%s::text[], %s::text[]) AS given (name, value)",
                    (list(settings), list(settings.values())),
                )
                # What the server does beyond that, such as waiting for a standby, stays.
                self._open.execute(
                    "SELECT set_config('synchronous_commit', 'on', false) "
                    "WHERE current_setting('synchronous_commit') IN ('off', 'local')"
                )
            except self._psycopg.Error:
                self._not_before = time.monotonic() + self._pause.seconds
                self._pause.grow()
                self.close()
                raise
            self._pause.reset()
        return self._open

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Turn psycopg's errors into one sentence with the place and the remedy."""
        try:
            yield
        except self._psycopg.Error as error:
            trouble = _sentence(self.place, error)
            if self.trouble is None and not _state_of(error).startswith(_AGAIN):
                _log.warning("%s", trouble)
                self.trouble = trouble
            raise JournalError(trouble) from error


class _Cursor:
    def __init__(self, cursor: Any) -> None:
        self._cursor = cursor

    def execute(self, query: str, *values: object) -> Any:
        return self._cursor.execute(_in_psycopg(query), values)

    def insert(self, into: str, rows: Sequence[tuple[object, ...]], otherwise: str = "") -> None:
        """Insert `rows`, all of them on one way to the server and back."""
        if rows:
            places = ", ".join(["%s"] * len(rows[0]))
            self._cursor.executemany(f"INSERT INTO {into} VALUES ({places}) {otherwise}", rows)  # noqa: S608


@lru_cache(maxsize=128)
def _in_psycopg(query: str) -> str:
    return query.replace("%", "%%").replace("?", "%s")


def _state_of(error: BaseException | None) -> str:
    """The SQLSTATE of an error of psycopg; that of a lost connection where there is none."""
    return getattr(error, "sqlstate", None) or "08000"


def _sentence(place: str, error: Exception) -> str:
    """What went wrong at `place`, and the remedy."""
    fitting = [key for key in _REMEDIES if _state_of(error).startswith(key)]
    remedy = _REMEDIES[max(fitting, key=len)] if fitting else "see the log of the server"
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    said = one_line("; ".join(lines[:2])) or type(error).__name__
    return f"{place} failed ({said}); {remedy}"
