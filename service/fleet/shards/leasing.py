"""The lease of a shard: without it, it neither writes nor publishes.

The database refuses what an earlier owner writes. What is published it does not see: there the machine's own clock,
which goes on while the process is stopped, tells whether the lease still holds.
"""

import asyncio
import logging
import threading
from collections.abc import Callable
from contextlib import suppress

from service.config.fleet import FleetConfig
from service.errors import Fenced, JournalError, LeaseHeld, ServiceError
from service.fleet.checks import connection_of
from service.publish.sinks import Announcement, Sink
from service.records.measures import Measure
from service.store.postgres.leases import Lease, Leases
from service.store.postgres.store import PostgresStore

LOOK = 0.5
"""How often it is tried to take a lease that somebody holds, s."""
RENEWALS = 3
"""How many times a lease is renewed before it would be over."""

_log = logging.getLogger(__name__)


class Leased:
    """The store of a site, and the lease of its writes, which is renewed for as long as the process lives."""

    def __init__(self, store: PostgresStore, leases: Leases, lease: Lease, seconds: float, lost: Callable[[], None]):
        """`lost` is called, from a thread, once another owner has the lease."""
        self.store = store
        self._leases, self._lease, self._seconds, self._lost = leases, lease, seconds, lost
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._renew, name="lease", daemon=True)
        self._thread.start()

    @property
    def held(self) -> bool:
        """Whether nobody else can have the lease yet."""
        return self._lease.is_safe()

    async def release(self) -> None:
        """Close the store, and let the next owner in at once."""
        self._over.set()
        await asyncio.to_thread(self._thread.join)
        try:
            await asyncio.to_thread(self.store.close)
        finally:
            with suppress(ServiceError):
                await asyncio.to_thread(self._leases.release, self._lease)
            await asyncio.to_thread(self._leases.close)

    def _renew(self) -> None:
        while not self._over.wait(self._seconds / RENEWALS):
            try:
                self._lease = self._leases.renew(self._lease, self._seconds)
            except Fenced as error:
                _log.error("%s", error)
                self._lost()
                return
            except JournalError as error:
                # Nothing is written meanwhile, and once it is over nothing is published. Who could take it needs the
                # database as well.
                _log.warning("the lease '%s' cannot be renewed: %s", self._lease.name, error)


async def take_lease(fleet: FleetConfig, site: str, name: str, owner: str, lost: Callable[[], None]) -> Leased:
    """Wait until the lease `name` is free, and take it for `owner`."""
    connection = connection_of(fleet)
    while True:
        try:
            return await asyncio.to_thread(_taken, connection, site, name, owner, fleet.lease, lost)
        except LeaseHeld as error:
            _log.info("%s", error)
        except JournalError as error:
            _log.error("%s waits for its lease: %s", name, error)
        await asyncio.sleep(LOOK)


def _taken(connection: str, site: str, name: str, owner: str, seconds: float, lost: Callable[[], None]) -> Leased:
    leases = Leases(connection, site)
    try:
        lease = leases.acquire(name, owner, seconds)
        return Leased(PostgresStore(connection, site, lease), leases, lease, seconds, lost)
    except BaseException:
        leases.close()
        raise


class LeasedSink(Sink):
    """A sink that passes on what is announced while the lease holds, and nothing afterwards. Who opened the sink closes
    it."""

    def __init__(self, sink: Sink, leased: Leased) -> None:
        self._sink, self._leased = sink, leased

    def add(self, zone: str) -> None:
        self._sink.add(zone)

    def remove(self, zone: str) -> None:
        self._sink.remove(zone)

    def publish(self, announcement: Announcement) -> None:
        if self._leased.held:
            self._sink.publish(announcement)

    def measures(self) -> list[Measure]:
        return self._sink.measures()
