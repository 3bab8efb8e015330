"""Leases: who may write now, by the database's clock. A lease belongs to one owner until it expires, is released or is
taken by a later one; each time it changes hands, its epoch grows by one. A zone belongs to a lease in one of its
epochs. Every transaction that writes checks both, and locks the key of the lease until it ends; the rows of zones need
no lock, for a zone leaves its lease only by the hand of its owner, or after the lease has been taken."""

import logging
import time
from collections.abc import Collection
from typing import NamedTuple

from adapters.fields.words import listed
from service.errors import Fenced, LeaseHeld
from service.store.database import Cursor
from service.store.postgres.database import PostgresDatabase
from service.store.postgres.schema import prepare

_OWN = "name = ? AND owner = ? AND epoch = ?"
_LEFT = "extract(epoch FROM expires - clock_timestamp())::float8"
"""s until a lease expires."""

_log = logging.getLogger(__name__)


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

    def is_safe(self) -> bool:
        """Whether nobody else can have it yet: what it allows may be published."""
        return steady() < self.until


class Leases:
    """The leases of `site` in the database that `connection` names. Blocking, for one thread at a time.

    Times are measured by the database: only how fast the clock of a machine goes matters here, not what it shows.
    """

    def __init__(self, connection: str, site: str) -> None:
        self._database = PostgresDatabase(connection, site)
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
                "VALUES (?, ?, 1, clock_timestamp() + make_interval(secs => ?)) ON CONFLICT (name) DO UPDATE "
                "SET owner = excluded.owner, epoch = leases.epoch + 1, expires = excluded.expires "
                "WHERE leases.owner IS NULL OR leases.owner = excluded.owner OR leases.expires <= clock_timestamp() "
                "RETURNING epoch",
                name,
                owner,
                float(seconds),
            ).fetchone()
            if taken is not None:
                return int(taken[0])
            other, left = cursor.execute(f"SELECT owner, {_LEFT} FROM leases WHERE name = ?", name).fetchone()  # noqa: S608
            raise LeaseHeld(name, other or "nobody", max(0.0, left))

        asked = steady()
        return Lease(name, owner, self._database.transaction(work), asked + seconds)

    def renew(self, lease: Lease, seconds: float) -> Lease:
        """The same lease for `seconds` from now; Fenced if it has been taken."""

        def work(cursor: Cursor) -> None:
            query = f"UPDATE leases SET expires = clock_timestamp() + make_interval(secs => ?) WHERE {_OWN}"  # noqa: S608
            if cursor.execute(query, float(seconds), *lease[:3]).rowcount == 0:
                raise Fenced(_lost(lease))

        asked = steady()
        self._database.transaction(work)
        return lease._replace(until=asked + seconds)

    def release(self, lease: Lease) -> None:
        """Give it up, with all its zones; nothing happens if it has been taken already."""
        query = f"UPDATE leases SET owner = NULL, epoch = epoch + 1 WHERE {_OWN}"  # noqa: S608
        self._database.transaction(lambda cursor: cursor.execute(query, *lease[:3]))

    def close(self) -> None:
        """Close the connection; safe to call twice."""
        self._database.close()


class LeasedDatabase(PostgresDatabase):
    """The tables of `site`, of which those zones are this owner's that belong to `lease`."""

    def __init__(self, connection: str, site: str, lease: Lease) -> None:
        super().__init__(connection, site)
        self.lease = lease
        self.lost: str | None = None
        """Why nothing can be written any more; None while the lease is held."""

    def take(self, cursor: Cursor, zone: str) -> None:
        """Make `zone` one of the lease. Fenced while another lease that has not expired holds it."""
        self._held(cursor, ())
        cursor.execute("INSERT INTO zones (zone, fingerprint) VALUES (?, '') ON CONFLICT DO NOTHING", zone)
        name, epoch = cursor.execute("SELECT lease, epoch FROM zones WHERE zone = ? FOR UPDATE", zone).fetchone()
        if (name, epoch) == (self.lease.name, self.lease.epoch):
            return
        if name is not None and name != self.lease.name:
            _overcome(cursor, zone, name, epoch)
        cursor.execute("UPDATE zones SET lease = ?, epoch = ? WHERE zone = ?", self.lease.name, self.lease.epoch, zone)

    def give_up(self, cursor: Cursor, zone: str) -> None:
        name, _, epoch, _ = self.lease
        cursor.execute("UPDATE zones SET lease = NULL WHERE zone = ? AND lease = ? AND epoch = ?", zone, name, epoch)

    def writable(self, cursor: Cursor, zones: Collection[str], wanted: Collection[str]) -> Collection[str]:
        held = self._held(cursor, {*zones, *wanted})
        if others := sorted(set(zones) - held):
            shown = listed([f"'{zone}'" for zone in others], 3)
            raise Fenced(
                f"zone {shown} is not held by the lease '{self.lease.name}' of {self.lease.owner} (epoch "
                f"{self.lease.epoch}), so nothing is written to it; it has gone to another owner, or was not claimed",
                others,
            )
        return held

    def own_zones(self) -> list[str]:
        name, _, epoch, _ = self.lease
        query = "SELECT zone FROM zones WHERE lease = ? AND epoch = ? ORDER BY zone"
        return [zone for (zone,) in self.read(query, name, epoch)]

    def _held(self, cursor: Cursor, zones: Collection[str]) -> set[str]:
        """Those of `zones` that may be written to in this transaction; Fenced if the lease is lost."""
        rows = cursor.execute(
            "SELECT zone FROM leases LEFT JOIN zones ON lease = name AND zones.epoch = leases.epoch AND zone = ANY(?) "
            "WHERE name = ? AND owner = ? AND leases.epoch = ? FOR KEY SHARE OF leases",
            sorted(zones),
            *self.lease[:3],
        ).fetchall()
        if not rows:
            if self.lost is None:
                self.lost = _lost(self.lease)
                _log.error("%s", self.lost)
            raise Fenced(self.lost)
        return {zone for (zone,) in rows if zone is not None}


def _overcome(cursor: Cursor, zone: str, name: str, epoch: int) -> None:
    """Make sure that the lease `name`, which holds `zone` in its `epoch`, can write to nothing."""
    query = f"SELECT owner, {_LEFT} FROM leases WHERE name = ? AND epoch = ? AND owner IS NOT NULL FOR UPDATE"  # noqa: S608
    row = cursor.execute(query, name, epoch).fetchone()
    if row is None:
        return
    owner, left = row
    if left > 0:
        raise Fenced(
            f"zone '{zone}' belongs to the lease '{name}' of {owner} for {left:.0f} s more; wait, or stop it", [zone]
        )
    cursor.execute("UPDATE leases SET owner = NULL, epoch = epoch + 1 WHERE name = ?", name)


def _lost(lease: Lease) -> str:
    """What is told of a `lease` that has been taken."""
    return (
        f"the lease '{lease.name}' of {lease.owner} (epoch {lease.epoch}) has gone to another owner, and nothing is "
        "written under it any more; acquire it again, and restore its zones"
    )
