"""The fence: no transaction writes for an owner whose lease, or whose zone, has gone to another one.

The key of the own lease is locked until the transaction ends, so that nobody can take it in the middle. The
rows of zones need no lock: a zone leaves its lease only by the hand of its owner, or after the lease has been taken.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from datetime import UTC, datetime

from adapters.fields.words import listed
from service.errors import Fenced
from service.store.postgres.database import Cursor
from service.store.postgres.leases import Lease, lost

_log = logging.getLogger(__name__)


class Fence:
    """What the owner of `lease` may write to."""

    def __init__(self, lease: Lease) -> None:
        self.lease = lease
        self.lost: str | None = None
        """Why nothing can be written any more; None while the lease is held."""

    def held(self, cursor: Cursor, zones: Collection[str] = ()) -> dict[str, int]:
        """The numbers of those of `zones` that may be written to in this transaction; Fenced if the lease is lost."""
        row = cursor.execute(
            "SELECT ARRAY(SELECT number FROM zones WHERE zone = ANY(%(zones)b::text[]) AND lease = held.name "
            "AND epoch = held.epoch ORDER BY number), "
            "ARRAY(SELECT zone FROM zones WHERE zone = ANY(%(zones)b::text[]) AND lease = held.name "
            "AND epoch = held.epoch ORDER BY number) "
            "FROM leases AS held WHERE name = %(name)s AND owner = %(owner)s AND epoch = %(epoch)s FOR KEY SHARE",
            {"zones": sorted(zones), **self.lease._asdict()},
        ).fetchone()
        if row is None:
            if self.lost is None:
                self.lost = lost(self.lease)
                _log.error("%s", self.lost)
            raise Fenced(self.lost)
        numbers, names = row
        return dict(zip(names, numbers, strict=True))

    def required(self, cursor: Cursor, zones: Collection[str], wanted: Collection[str] = ()) -> dict[str, int]:
        """The numbers of all `zones`, and of those `wanted` that may be written to; Fenced where one of `zones` may
        not."""
        held = self.held(cursor, {*zones, *wanted})
        others = sorted(set(zones) - held.keys())
        if others:
            raise Fenced(_elsewhere(self.lease, others), others)
        return held

    def keep(self, cursor: Cursor, zones: Collection[str]) -> set[str]:
        """Keep those of `zones` that were of the lease under its owner before; all that are of it now."""
        self.held(cursor)
        cursor.execute(
            "UPDATE zones SET epoch = %s WHERE zone = ANY(%b::text[]) AND lease = %s AND epoch < %s",
            (self.lease.epoch, sorted(zones), self.lease.name, self.lease.epoch),
        )
        return set(self.held(cursor, zones))

    def take(self, cursor: Cursor, zone: str) -> int:
        """Make `zone` one of the lease; its number. Fenced while another lease that has not expired holds it."""
        self.held(cursor)
        cursor.execute("INSERT INTO zones (zone) VALUES (%s) ON CONFLICT DO NOTHING", (zone,))
        number, name, epoch = cursor.execute(
            "SELECT number, lease, epoch FROM zones WHERE zone = %s FOR UPDATE", (zone,)
        ).fetchone()
        if (name, epoch) == (self.lease.name, self.lease.epoch):
            return int(number)
        if name is not None and name != self.lease.name:
            self._overcome(cursor, zone, name, epoch)
        cursor.execute(
            "UPDATE zones SET lease = %s, epoch = %s WHERE number = %s", (self.lease.name, self.lease.epoch, number)
        )
        return int(number)

    def _overcome(self, cursor: Cursor, zone: str, name: str, epoch: int) -> None:
        """Make sure that the lease `name` in its `epoch` can write to nothing."""
        row = cursor.execute(
            "SELECT owner, extract(epoch FROM expires - clock_timestamp())::float8 FROM leases "
            "WHERE name = %s AND epoch = %s AND owner IS NOT NULL FOR UPDATE",
            (name, epoch),
        ).fetchone()
        if row is None:
            return
        owner, left = row
        if left > 0:
            raise Fenced(
                f"zone '{zone}' belongs to the lease '{name}' of {owner} for {left:.0f} s more; wait, or stop it",
                [zone],
            )
        cursor.execute("UPDATE leases SET owner = NULL, epoch = epoch + 1 WHERE name = %s", (name,))


def _elsewhere(lease: Lease, zones: Sequence[str]) -> str:
    shown = listed([f"'{zone}'" for zone in zones], 3)
    return (
        f"zone {shown} is not held by the lease '{lease.name}' of {lease.owner} (epoch {lease.epoch}), so nothing is "
        "written to it; it has gone to another owner, or was not claimed"
    )


def set_aside_as(cursor: Cursor, zone: str) -> int:
    """The number of a new zone that nobody can have, for what is set aside of `zone`."""
    return int(cursor.execute("INSERT INTO zones (zone) VALUES (%s) RETURNING number", (aside(zone),)).fetchone()[0])


def aside(zone: str) -> str:
    """A name that no zone can have, for what is set aside of `zone`."""
    return f"{zone}@{datetime.now(UTC).isoformat()}"
