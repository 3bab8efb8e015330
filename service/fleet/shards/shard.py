"""A shard: some hundred zones in a process of their own, run as the daemon runs them, as long as its lease holds."""

from __future__ import annotations

import asyncio
import logging
import os
import secrets
from collections.abc import Collection, Mapping, Sequence
from contextlib import AsyncExitStack
from typing import Any

from prometheus_client import Metric

from adapters.fields.times import written_time
from adapters.http.posted import Posted
from service.config.fitting import fingerprint
from service.config.site import Config
from service.daemon.composition import RunningSite, answer_on_zenoh, open_sinks
from service.daemon.logs import configure_logging
from service.daemon.process import favour_the_event_loop
from service.daemon.supply.feeds import Handed, narrowed
from service.daemon.supply.ingest import hand
from service.daemon.tasks import end
from service.errors import Away, ServiceError, StateMismatch
from service.fleet.messages import Beat, News
from service.fleet.peers import end_process, own_node, remembered
from service.fleet.plan import QUARANTINE
from service.fleet.shards.crashes import Crashes, Suspect, told
from service.fleet.shards.herald import Herald
from service.fleet.shards.leasing import Leased, Vouched, take_lease
from service.publish.sinks import Sink
from service.records.asker import Asker, asked_by

_log = logging.getLogger(__name__)


class Shard:
    """The body of a shard. It begins with its first plan."""

    def __init__(self, site: str, name: str) -> None:
        self._site, self._name = site, name
        self._boot, self._node = secrets.token_hex(8), own_node()
        self._version = 0
        self._work: _Work | None = None
        self._adopting = asyncio.Lock()
        self._askers: dict[str, Asker] = {}
        """On whose behalf each open question is answered."""
        self._waking: asyncio.Task[None] | None = None
        self._crashes = Crashes(site, name)
        for suspect in self._crashes.suspects:
            _log.error(
                "zone '%s' was at work with its sample at %s when the process of %s ended, %d times now",
                suspect.zone,
                written_time(suspect.time),
                name,
                suspect.crashes,
            )

    async def wake(self) -> None:
        """Go on with the plan of before, if there is one with this shard; the steward tells all others."""
        favour_the_event_loop()
        self._waking = asyncio.create_task(self._go_on())

    async def _go_on(self) -> None:
        try:
            plan = await asyncio.to_thread(remembered, self._site)
            if plan is not None and self._name in plan.all_shards:
                await self.adopt(plan.version, plan.shares()[self._name])
        except ServiceError as error:
            _log.error("%s cannot go on yet: %s", self._name, error)

    async def beat(self) -> Beat:
        """A sign of life."""
        work = self._work
        zones, problems = (0, []) if work is None else (len(work.zones), work.leased.store.problems())
        beat = Beat(self._name, self._boot, self._node, os.getpid(), self._version, zones, work is not None, problems)
        return beat._replace(guilty={zone: told(each) for zone, each in _blamed(self._name, self._crashes).items()})

    async def adopt(self, version: int, config: Config) -> None:
        """Run the zones of `config`, and no others, from now on. Raises ServiceError."""
        async with self._adopting:
            if version <= self._version:
                return
            if self._work is None:
                configure_logging(config.log)
                self._work = await _Work.begin(self._site, self._name, self._boot, config, self._crashes)
            else:
                await self._work.go_over(config)
            self._version = version
            _log.info("%s runs %d zones by plan %d", self._name, len(self._work.zones), version)

    async def take(self, posted: Sequence[Posted], zone: str | None, expected: Collection[str]) -> Handed:
        """Take what clients posted for the zones `expected`; durable on return. Raises ServiceError: then all of it may
        be posted again, and counts as repeated where it was taken."""
        work, version = self._working(), self._version
        _have(work.zones, expected)
        handed = await hand(work.runtime.feeds, posted, zone)
        # A zone that left meanwhile has taken nothing, and nobody was told.
        _have(work.zones, expected)
        if self._adopting.locked() or version != self._version:
            raise Away(f"{self._name} is going over to another plan; post the readings again")
        return handed

    async def news(self, boot: str, since: int) -> News:
        """What the zones have announced since."""
        return await self._working().herald.news(boot, since)

    async def question(self, asker: str, number: str, zone: str, method: str, arguments: tuple[Any, ...]) -> Any:
        """What `method` of a zone answers a client. By its `number` the question can be given up."""
        zones = self._working().zones
        if zone not in zones:
            raise Away(f"zone '{zone}' is being moved; ask again in a moment")
        self._askers[number] = client = Asker(asker)
        asked_by(client)
        try:
            return await getattr(zones[zone], method)(*arguments)
        finally:
            del self._askers[number]

    async def give_up(self, number: str) -> None:
        """The client of a question has gone."""
        if (client := self._askers.get(number)) is not None:
            client.gone.set()

    async def metrics(self) -> list[Metric]:
        """Every metric of the shard as it is now."""
        registry = self._working().site.metrics.registry
        return await asyncio.to_thread(lambda: list(registry.collect()))

    async def stop(self) -> None:
        """Stop in order: mailboxes emptied, checkpoints written, the lease given back."""
        async with self._adopting:
            if self._work is not None:
                await self._work.stop()
                self._work = None
            self._crashes.close()

    def _working(self) -> _Work:
        if self._work is None:
            raise Away(f"{self._name} is starting")
        return self._work


class _Work:
    """What a shard runs under its lease: a site of its own, for its part of the zones."""

    def __init__(
        self, name: str, boot: str, config: Config, leased: Leased, opened: Sequence[Sink], crashes: Crashes
    ) -> None:
        self.leased = leased
        self._name, self._crashes = name, crashes
        self.herald = Herald(boot)
        assert config.fleet is not None
        threads = max(1, round(config.fleet.shard_cpus))
        sinks = [Vouched(sink, leased) for sink in (*opened, self.herald)]
        self.site = RunningSite(config, leased.store, sinks, threads, stepping=crashes.stepping)
        self.runtime, self.zones = self.site.runtime, self.site.zones
        self.herald.zones = self.zones
        self._leaving: set[str] = set()
        """Zones that are stopped, or are to be, and not given up yet."""
        self._rest = AsyncExitStack()

    @classmethod
    async def begin(cls, site: str, name: str, boot: str, config: Config, crashes: Crashes) -> _Work:
        """Wait for the lease and start the zones. Where that fails, nothing of it is left, the lease included."""
        assert config.fleet is not None
        owner = f"process {os.getpid()} on {own_node()[:8]} ({boot})"
        leased = await take_lease(config.fleet, site, name, owner, end_process)
        async with AsyncExitStack() as undo:
            undo.push_async_callback(leased.release)
            opened = await open_sinks(config, undo)
            sound, refused = await _sound(config, name, leased, crashes)
            work = cls(name, boot, sound, leased, opened, crashes)
            undo.push_async_callback(work.site.close)
            undo.push_async_callback(work.site.stop)
            work.herald.refused = refused
            # What concerns several zones the gateways answer, who know those of all shards.
            await answer_on_zenoh(opened, sound, work.zones, lambda: leased.held, of_site=False)
            await work.runtime.declare()
            await work.runtime.restore()
            work.runtime.start_zones()
            await work.site.feed()
            watching = asyncio.create_task(work.herald.watch())
            undo.push_async_callback(end, [watching])
            work.runtime.broken.add_done_callback(_broken)
            work._rest = undo.pop_all()
        return work

    async def go_over(self, config: Config) -> None:
        """Run the zones of `config`; those that are the same go on untouched. Raises ServiceError."""
        sound, refused = await _sound(config, self._name, self.leased, self._crashes)
        self.herald.refused = refused
        before = self.runtime.config
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


async def _sound(config: Config, name: str, leased: Leased, crashes: Crashes) -> tuple[Config, dict[str, str]]:
    """`config` with the zones that the shard can run, and why it cannot run the others: one zone's mistake is not the
    others'. The shard holds none of those that it refuses, so that another one can take them."""
    blamed = _blamed(name, crashes)
    refused = {
        zone.id: f"{told(blamed[zone.id])}; it goes on in quarantine" for zone in config.zones if zone.id in blamed
    }
    wanted = [zone for zone in config.zones if zone.id not in refused]
    for zone in wanted:
        try:
            await leased.store.claim(zone.id, fingerprint(zone))
        except StateMismatch as error:
            _log.error("%s", error)
            refused[zone.id] = str(error)
            await leased.store.give_up(zone.id)
            continue
        suspect = crashes.guilty.get(zone.id)
        if suspect is not None:
            _log.error("zone '%s' passes over its sample: %s", zone.id, told(suspect))
            await leased.store.write(leased.store.journal.skip, zone.id, suspect.time, told(suspect))
    return narrowed(config, [zone.id for zone in config.zones if zone.id not in refused]), refused


def _blamed(name: str, crashes: Crashes) -> Mapping[str, Suspect]:
    """The zones that the shard `name` leaves to quarantine."""
    return {} if name == QUARANTINE else crashes.guilty


def _have(zones: Collection[str], expected: Collection[str]) -> None:
    """Raises Away where one of the `expected` zones is not among `zones`."""
    if missing := [name for name in expected if name not in zones]:
        raise Away(f"zone '{missing[0]}' is being moved; post the readings again")


def _broken(outcome: asyncio.Future[None]) -> None:
    if not outcome.cancelled() and (error := outcome.exception()) is not None:
        _log.error("a zone has ended with an error that only a new process helps against: %r", error)
        end_process()
