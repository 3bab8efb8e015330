"""The library psycopg, imported when it is needed, and how the errors of PostgreSQL become sentences."""

from __future__ import annotations

from types import ModuleType

from service.errors import JournalError, one_line

_DAMAGED = "look in the log of the server whether its disk has failed, and restore a backup (docs/operations.md)"
_PLACE = "free space on the disk of the server, or give it more; the rows of reset zones and old months may go"

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
    "XX": _DAMAGED,
}
"""By SQLSTATE or the beginning of one, the longest first that fits."""

BROKEN = ("08", "25006", "25P03", "57P")
"""SQLSTATEs after which the connection is made anew. After a change of the primary it leads to another server."""

AGAIN = ("40001", "40P01", "23505", "23514")
"""SQLSTATEs after which a transaction is tried again.

Beside conflicts: a row that is there already is one of an earlier attempt whose end was not known, or of an owner that
is fenced meanwhile; and a partition may have been dropped by another shard.
"""


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


def state_of(error: Exception) -> str:
    """The SQLSTATE of an error of psycopg; that of a lost connection where there is none."""
    return getattr(error, "sqlstate", None) or "08000"


def is_one_of(state: str, states: tuple[str, ...]) -> bool:
    """Whether `state` begins with one of `states`."""
    return state.startswith(states)


def sentence(place: str, error: Exception) -> str:
    """What went wrong at `place`, and the remedy."""
    state = state_of(error)
    fitting = [key for key in _REMEDIES if state.startswith(key)]
    remedy = _REMEDIES[max(fitting, key=len)] if fitting else "see the log of the server"
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    said = one_line("; ".join(lines[:2])) or type(error).__name__
    return f"the database {place} failed ({said}); {remedy}"
