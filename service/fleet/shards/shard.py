"""A shard: some hundred zones in a process of their own, run as the daemon runs them, as long as its lease holds."""

import asyncio
import logging
import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import AsyncExitStack
from typing import Any, Self

from prometheus_client import Metric

from adapters.http.posted import Posted
from service.config.fitting import fingerprint
from service.config.site import Config
from service.daemon.composition import RunningSite, answer_on_zenoh, open_sinks
from service.daemon.logs import configure_logging
from service.daemon.supply.feeds import narrowed
from service.daemon.supply.ingest import hand
from service.daemon.tasks import end
from service.errors import Away, Fenced, StateMismatch
from service.fleet.checks import fleet_of
from service.fleet.member import Member
from service.fleet.messages import News
from service.fleet.peers import end_process
from service.fleet.plan import Plan
from service.fleet.shards.crashes import MOST, Crashes
from service.fleet.shards.leasing import Leased, LeasedSink, take_lease
from service.fleet.shards.outbox import Outbox
from service.publish.sinks import Sink
from service.records.asker import Asker, asked_by
from service.records.receipt import Receipt

_DAY = 86_400
_PASSED = "SELECT count(*) FROM samples WHERE zone = ? AND time > ? AND skipped LIKE '% processes ended %'"

_log = logging.getLogger(__name__)


class Shard(Member):
    """The body of a shard. It begins with its first plan."""

    def __init__(self, site: str, name: str) -> None:
        super().__init__(site, name)
        self._work: _Work | None = None
        self._crashes = Crashes(site, name)
        for suspect in self._crashes.suspects:
            _log.error("zone '%s' of %s: %s", suspect.zone, name, suspect)

    def state(self) -> Mapping[str, Any]:
        work = self._work
        if work is None:
            return {}
        return {"zones": len(work.zones), "ready": True, "problems": work.leased.store.problems()}

    async def adopt(self, plan: Plan) -> frozenset[str]:
        """Run the zones of `plan` that are this shard's, and no others, from now on; those that another one has."""
        if self.name not in plan.shards:
            return frozenset()
        config = plan.share(self.name)
        if self._work is None:
            configure_logging(config.log)
            owner = f"process {os.getpid()} on {self.node[:8]} ({self.boot})"
            self._work = await _Work.begin(self.site, self.name, owner, config, self._crashes)
        else:
            await self._work.go_over(config)
        if plan.version > self.version:
            _log.info("%s runs %d zones by plan %d", self.name, len(self._work.zones), plan.version)
        return self._work.waiting

    async def take(self, posted: Sequence[Posted], zone: str | None, expected: Collection[str]) -> Receipt:
        """Take what clients posted for the zones `expected`; durable on return. Raises ServiceError: then all of it may
        be posted again, and counts as repeated where it was taken."""
        work, version = self._working(), self.version
        _have(work.zones, expected)
        receipt = await hand(work.runtime.feeds, posted, zone)
        # A zone that left meanwhile has taken nothing, and nobody was told.
        _have(work.zones, expected)
        if self.adopting or version != self.version:
            raise Away(f"{self.name} is going over to another plan; post the readings again")
        return receipt

    async def news(self, boot: str, since: int) -> News:
        """What the zones have announced since."""
        return await self._working().outbox.news(boot, since)

    async def question(self, asker: str, zone: str, method: str, arguments: tuple[Any, ...]) -> Any:
        """What `method` of a zone answers a client; it is given up when this is cancelled."""
        zones = self._working().zones
        if zone not in zones:
            raise Away(f"zone '{zone}' is being moved; ask again in a moment")
        client = Asker(asker)
        asked_by(client)
        try:
            return await getattr(zones[zone], method)(*arguments)
        finally:
            client.gone.set()

    async def metrics(self) -> list[Metric]:
        registry = self._working().site.metrics.registry
        return await asyncio.to_thread(lambda: list(registry.collect()))

    async def end(self) -> None:
        """Mailboxes emptied, checkpoints written, the lease given back."""
        if self._work is not None:
            await self._work.stop()
            self._work = None
        self._crashes.close()

    def _working(self) -> "_Work":
        if self._work is None:
            raise Away(f"{self.name} is starting")
        return self._work


class _Work:
    """What a shard runs under its lease: a site of its own, for its part of the zones."""

    def __init__(self, config: Config, leased: Leased, opened: Sequence[Sink], crashes: Crashes) -> None:
        self.leased = leased
        self.outbox = Outbox(config.site.id)
        threads = max(1, round(fleet_of(config).shard_cpus))
        sinks = [LeasedSink(sink, leased) for sink in (*opened, self.outbox)]
        self.site = RunningSite(config, leased.store, sinks, threads, stepping=crashes.stepping)
        self.runtime, self.zones = self.site.runtime, self.site.zones
        self.outbox.zones = self.zones
        self.waiting: frozenset[str] = frozenset()
        """Zones that another shard still has."""
        self._leaving: set[str] = set()
        """Zones that are stopped, or are to be, and not given up yet."""
        self._rest = AsyncExitStack()

    @classmethod
    async def begin(cls, site: str, name: str, owner: str, config: Config, crashes: Crashes) -> Self:
        """Wait for the lease and start the zones. Where that fails, nothing of it is left, the lease included."""
        leased = await take_lease(fleet_of(config), site, name, owner, end_process)
        async with AsyncExitStack() as undo:
            undo.push_async_callback(leased.release)
            opened = await open_sinks(config, undo)
            sound, refused, waiting = await claimed(config, leased, crashes)
            work = cls(sound, leased, opened, crashes)
            undo.push_async_callback(work.site.close)
            undo.push_async_callback(work.site.stop)
            work.outbox.refused, work.waiting = refused, waiting
            # What concerns several zones the gateways answer, who know those of all shards.
            await answer_on_zenoh(opened, sound, work.zones, lambda: leased.held, of_site=False)
            await work.runtime.declare()
            await work.runtime.restore()
            work.runtime.start_zones()
            await work.site.feed()
            undo.push_async_callback(end, [asyncio.create_task(work.outbox.watch())])
            work.runtime.broken.add_done_callback(_broken)
            work._rest = undo.pop_all()
        return work

    async def go_over(self, config: Config) -> None:
        """Run the zones of `config`; those that are the same go on untouched. Raises ServiceError."""
        before = self.runtime.config
        sound, self.outbox.refused, self.waiting = await claimed(config, self.leased, None, before)
        self._leaving |= {zone.id for zone in before.zones}
        # The other tables take effect with the next start of the shard.
        kept = {name: getattr(before, name) for name in ("site", "http", "sinks")}
        await self.runtime.reload(sound.model_copy(update=kept))
        self._leaving -= self.zones.keys()
        for zone in tuple(self._leaving):
            await self.leased.store.give_up(zone)
            self._leaving.discard(zone)
        if before.log != config.log:
            configure_logging(config.log)

    async def stop(self) -> None:
        """Stop in order. Where something cannot be stopped, the rest is all the same, and then it is raised."""
        await self._rest.aclose()


async def claimed(
    config: Config, leased: Leased, crashes: Crashes | None, before: Config | None = None
) -> tuple[Config, dict[str, str], frozenset[str]]:
    """`config` with the zones that the shard can run, why it cannot run others, and those that another shard has: one
    zone's mistake is not the others'. The shard holds none of those that it refuses. It holds the zones `before`; what
    its `crashes` blame is passed over."""
    refused, waiting, guilty = dict[str, str](), set[str](), {} if crashes is None else crashes.guilty
    held = () if before is None else before.zones
    for zone in config.zones:
        if zone in held:
            continue
        try:
            await leased.store.claim(zone.id, fingerprint(zone))
        except StateMismatch as error:
            _log.error("%s", error)
            refused[zone.id] = str(error)
            await leased.store.give_up(zone.id)
        except Fenced as error:
            if not error.zones:
                raise
            waiting.add(zone.id)
        else:
            suspect = guilty.get(zone.id)
            if suspect is None or suspect.time != await leased.store.run(
                leased.store.journal.sample_time_until, zone.id, suspect.time
            ):
                continue
            _log.error("zone '%s' passes over its sample: %s", zone.id, suspect)
            await leased.store.run(leased.store.journal.skip, zone.id, suspect.time, str(suspect))
            ((passed,),) = await leased.store.run(leased.store.journal.read, _PASSED, zone.id, suspect.time - _DAY)
            if passed > MOST:
                refused[zone.id] = f"{suspect}, and it was like that with {passed - 1} others of a day"
                await leased.store.give_up(zone.id)
    sound = [zone.id for zone in config.zones if zone.id not in refused and zone.id not in waiting]
    return narrowed(config, sound), refused, frozenset(waiting)


def _have(zones: Collection[str], expected: Collection[str]) -> None:
    """Raises Away where one of the `expected` zones is not among `zones`."""
    if missing := [name for name in expected if name not in zones]:
        raise Away(f"zone '{missing[0]}' is being moved; post the readings again")


def _broken(outcome: asyncio.Future[None]) -> None:
    if not outcome.cancelled() and (error := outcome.exception()) is not None:
        _log.error("a zone has ended with an error that only a new process helps against: %r", error)
        end_process()
