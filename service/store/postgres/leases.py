"""Leases: who may write now, by the database's clock.

A lease belongs to one owner until it expires, is released or is taken by a later one; each time it is taken, its epoch
grows by one. A zone belongs to a lease in one of its epochs, and every transaction that writes checks both.
"""

from __future__ import annotations

from typing import NamedTuple


class Lease(NamedTuple):
    """The lease `name`, such as that of a shard, in the hands of `owner`; `epoch` is its fencing token."""

    name: str
    owner: str
    epoch: int
    until: float
    """When it expires unless it is renewed, s on the clock of `steady`; never later than the database has it."""

    def is_safe(self, margin: float = 0.0) -> bool:
        """Whether nobody else can have it yet, nor in `margin` s: what it allows may be published."""
        raise NotImplementedError


class Leases:
    """The leases of `site` in the database that `connection` names. Blocking; may be asked from any thread."""

    def __init__(self, connection: str, site: str) -> None:
        raise NotImplementedError

    def acquire(self, name: str, owner: str, seconds: float) -> Lease:
        """Take the lease `name` for `seconds`, in a new epoch.

        It has to be free, expired, or of the same `owner`, whose earlier epoch is fenced then; else LeaseHeld, which
        tells in how many s it expires. ServiceError where the database cannot be reached.
        """
        raise NotImplementedError

    def renew(self, lease: Lease, seconds: float) -> Lease:
        """The same lease for `seconds` from now; Fenced if it has been taken."""
        raise NotImplementedError

    def release(self, lease: Lease) -> None:
        """Give it up, with all its zones; nothing happens if it has been taken already."""
        raise NotImplementedError

    def close(self) -> None:
        """Close the connection; safe to call twice."""
        raise NotImplementedError
