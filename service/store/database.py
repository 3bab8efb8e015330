"""The tables of the journal, and what a database has to do for it, be it SQLite's or PostgreSQL's."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from typing import Any, ClassVar, Protocol, TypeVar

Result = TypeVar("Result")

SCHEMA = """
CREATE TABLE samples (
    zone TEXT NOT NULL, time INTEGER NOT NULL, outputs BLOB NOT NULL, inputs BLOB NOT NULL,
    output_quality TEXT NOT NULL, input_quality TEXT NOT NULL, skipped TEXT, link INTEGER, setpoint REAL,
    PRIMARY KEY (zone, time)
) WITHOUT ROWID;
CREATE TABLE zones (zone TEXT PRIMARY KEY, fingerprint TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE history (
    zone TEXT NOT NULL, time INTEGER NOT NULL, y REAL, mean REAL, lower REAL, upper REAL, sd REAL, residual REAL,
    alpha_lower REAL, alpha_median REAL, alpha_upper REAL, cdf REAL, gate REAL, n_eff REAL, resampled INTEGER,
    log_likelihood REAL, segment INTEGER, checksum INTEGER, gain_lower REAL, gain_median REAL, gain_upper REAL,
    setpoint REAL,
    PRIMARY KEY (zone, time)
) WITHOUT ROWID;
CREATE TABLE pruned (zone TEXT PRIMARY KEY, time INTEGER NOT NULL, link INTEGER) WITHOUT ROWID;
CREATE TABLE forgotten (zone TEXT PRIMARY KEY) WITHOUT ROWID;
CREATE TABLE readings (
    zone TEXT NOT NULL, time REAL NOT NULL, channel TEXT NOT NULL, value REAL NOT NULL, quality TEXT NOT NULL,
    checksum INTEGER NOT NULL, PRIMARY KEY (zone, time, channel)
) WITHOUT ROWID;
"""
"""In SQLite's words."""


class Cursor(Protocol):
    """What a transaction works with. Questions have ? in the place of their values."""

    def execute(self, query: str, *values: object) -> Any:
        """The cursor of the library, with `fetchone`, `fetchall` and `rowcount`."""

    def insert(self, into: str, rows: Sequence[tuple[object, ...]], otherwise: str = "") -> None:
        """Insert `rows` into a table with its columns; `otherwise` is what to do with those that are there."""


class Database(ABC):
    """A database with the tables of the journal: blocking, for one thread at a time.

    `place` says in messages where it is, and `reset` how state is given up there (None: by `thermogate run --reset`).
    Every method may raise JournalError with the place and the remedy. Here all zones are the caller's; a database that
    several owners share knows those of each, and raises Fenced for the others.
    """

    reset: ClassVar[str | None] = None
    least_pruned: ClassVar[int] = 0
    """Rows of a zone are deleted for their age once there are so many s of them."""

    place: str
    trouble: str | None = None
    """Why nothing can be written now; None if it can, as far as is known."""

    @abstractmethod
    def read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        """All rows of a question."""

    @abstractmethod
    def transaction(self, work: Callable[[Cursor], Result]) -> Result:
        """What `work` returns, with all of what it wrote durable, or nothing of it. It may be called several times, the
        last time after a commit whose end is not known, and has to look what is there already."""

    @abstractmethod
    def size(self) -> int:
        """Bytes that the journal takes on the disk."""

    def shrink(self) -> bool | None:
        """Give space of deleted rows back to the disk; whether there was any. None: it is kept for later rows."""
        return None

    @abstractmethod
    def close(self) -> None:
        """Close the connection; safe to call twice."""

    def take(self, cursor: Cursor, zone: str) -> None:
        return None

    def give_up(self, cursor: Cursor, zone: str) -> None:
        """Leave `zone` to whoever takes it next; nothing if it has gone."""
        return None

    def writable(self, cursor: Cursor, zones: Collection[str], wanted: Collection[str]) -> Collection[str]:
        """Those of the `wanted` zones that are this owner's; Fenced unless all `zones` are."""
        return wanted

    def own_zones(self) -> list[str] | None:
        return None


def other_version(place: str, there: int, reads: int, elsewhere: str) -> str:
    """What is told of a schema that is `there`, and not the one that this version `reads`."""
    if there > reads:
        return (
            f"{place} has schema {there} of a newer Thermogate (this one reads {reads}); upgrade Thermogate, or use "
            f"another {elsewhere}"
        )
    return (
        f"{place} has schema {there} of an unreleased Thermogate, which this one does not read; use another {elsewhere}"
    )
