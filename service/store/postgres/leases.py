"""Leases: who may write now, by the database's clock.

A lease belongs to one owner until it expires, is released or is taken by a later one; each time it changes hands, its
epoch grows by one. A zone belongs to a lease in one of its epochs, and every transaction that writes checks both
(`service.store.postgres.fence`).
"""

from __future__ import annotations

import threading
import time
from typing import NamedTuple

from service.errors import Fenced, LeaseHeld
from service.store.postgres.database import Cursor, Database
from service.store.postgres.schema import prepare


def steady() -> float:
    """s on a clock that nobody sets, and that goes on while the machine sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class Lease(NamedTuple):
    """The lease `name`, such as that of a shard, in the hands of `owner`; `epoch` is its fencing token."""

    name: str
    owner: str
    epoch: int
    until: float
    """When it expires unless it is renewed, s on the clock of `steady`; never later than the database has it."""

    def is_safe(self, margin: float = 0.0) -> bool:
        """Whether nobody else can have it yet, nor in `margin` s: what it allows may be published."""
        return steady() + margin < self.until


class Leases:
    """The leases of `site` in the database that `connection` names. Blocking; may be asked from any thread.

    Times are measured by the database: only how fast the clock of a machine goes matters here, not what it shows.
    """

    def __init__(self, connection: str, site: str) -> None:
        self._database = Database(connection, site)
        self._one = threading.Lock()
        try:
            prepare(self._database)
        except BaseException:
            self._database.close()
            raise

    def acquire(self, name: str, owner: str, seconds: float) -> Lease:
        """Take the lease `name` for `seconds`, in a new epoch.

        It has to be free, expired, or of the same `owner`, whose earlier epoch is fenced then; else LeaseHeld, which
        tells in how many s it expires. JournalError where the database cannot be reached.
        """

        def work(cursor: Cursor) -> int:
            taken = cursor.execute(
                "INSERT INTO leases (name, owner, epoch, expires) "
                "VALUES (%(name)s, %(owner)s, 1, clock_timestamp() + make_interval(secs => %(seconds)s)) "
                "ON CONFLICT (name) DO UPDATE "
                "SET owner = excluded.owner, epoch = leases.epoch + 1, expires = excluded.expires "
                "WHERE leases.owner IS NULL OR leases.owner = excluded.owner OR leases.expires <= clock_timestamp() "
                "RETURNING epoch",
                {"name": name, "owner": owner, "seconds": float(seconds)},
            ).fetchone()
            if taken is not None:
                return int(taken[0])
            other, left = cursor.execute(
                "SELECT owner, extract(epoch FROM expires - clock_timestamp())::float8 FROM leases WHERE name = %s",
                (name,),
            ).fetchone()
            raise LeaseHeld(name, other or "nobody", max(0.0, left))

        with self._one:
            asked = steady()
            return Lease(name, owner, self._database.transaction(work), asked + seconds)

    def renew(self, lease: Lease, seconds: float) -> Lease:
        """The same lease for `seconds` from now; Fenced if it has been taken."""

        def work(cursor: Cursor) -> None:
            cursor.execute(
                "UPDATE leases SET expires = clock_timestamp() + make_interval(secs => %s) "
                "WHERE name = %s AND owner = %s AND epoch = %s",
                (float(seconds), *lease[:3]),
            )
            if cursor.rowcount == 0:
                raise Fenced(lost(lease))

        with self._one:
            asked = steady()
            self._database.transaction(work)
            return lease._replace(until=asked + seconds)

    def release(self, lease: Lease) -> None:
        """Give it up, with all its zones; nothing happens if it has been taken already."""
        query = "UPDATE leases SET owner = NULL, epoch = epoch + 1 WHERE name = %s AND owner = %s AND epoch = %s"
        with self._one:
            self._database.transaction(lambda cursor: cursor.execute(query, lease[:3]))

    def close(self) -> None:
        """Close the connection; safe to call twice."""
        with self._one:
            self._database.close()


def lost(lease: Lease) -> str:
    """What is told of a `lease` that has been taken."""
    return (
        f"the lease '{lease.name}' of {lease.owner} (epoch {lease.epoch}) has gone to another owner, and nothing is "
        "written under it any more; acquire it again, and restore its zones"
    )
