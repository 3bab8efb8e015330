"""The zones and sources of a running daemon: started, replaced by a reload, stopped."""

import asyncio
import logging
from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from service.config.fitting import fingerprint, make_alignment, make_worker, neighbourhood, surroundings
from service.config.site import Config, ZoneConfig
from service.daemon.reload import Changes, compare, obstacles
from service.daemon.supply.feeding import keep_time, watch_clock
from service.daemon.supply.feeds import Feed, Tally
from service.daemon.supply.weather import WeatherFeeds
from service.daemon.tasks import end
from service.daemon.zone_table import Zones
from service.errors import ReloadRefused, ServiceError
from service.zone.plumbing import Plumbing
from service.zone.zone import Zone

DRAIN_SECONDS = 2.0
"""How long a stop waits for the mailboxes; what is left is in the journal and assimilated at the next start."""
SAVE_SECONDS = 1.0
"""How long it then waits for the checkpoints."""
RETIRE_SECONDS = 30.0
"""How long a reload waits for the mailboxes of the zones that it stops."""

_log = logging.getLogger(__name__)


class _Running(NamedTuple):
    """A zone at work, and its worker."""

    zone: Zone
    worker: asyncio.Task[None]


class Runtime:
    """What the daemon runs. `zones` are always those that REST should show."""

    def __init__(self, config: Config, zones: Zones[Zone], plumbing: Plumbing) -> None:
        self.config = config
        self.zones = zones
        self.tallies: dict[str, Tally] = {}
        """What every source has done, by its name."""
        self.broken: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Fails when a zone ends with an error that trying again does not help against."""
        self._plumbing = plumbing
        self._running: dict[str, _Running] = {}
        self._feeds: list[Feed] = []
        self._weather = WeatherFeeds(plumbing.weather)
        self._clocks: list[asyncio.Task[None]] = []
        """What lets time pass for live zones."""
        self._reloading = asyncio.Lock()
        self._last: dict[str, int | None] = {}
        """Time of the last sample of each zone when it was restored."""
        zones.replace({table.id: self._built(table, config) for table in config.zones})
        self._surround(config)

    @property
    def feeds(self) -> tuple[Feed, ...]:
        return tuple(self._feeds)

    @property
    def is_posted_to(self) -> bool:
        """Whether a source of the configuration takes what clients post, be it at work already or not."""
        return any(table.kind == "http" and self.config.zones_of(name) for name, table in self.config.sources.items())

    async def declare(self) -> None:
        """Make the zones known to the sinks. Raises ServiceError."""
        await asyncio.to_thread(self._declare, list(self.zones))

    async def restore(self) -> None:
        """Bring every zone to where it stopped. Raises StateMismatch."""
        await self._prepare(self.zones, self.config.zones, self.config)

    def start_zones(self) -> None:
        """Let the zones take samples, and tell what they know."""
        for name in self.zones:
            self._start(name)

    async def start_feeds(self) -> None:
        """Let the sources deliver, and time pass."""
        await self._weather.follow(self.config)
        for name in self.config.sources:
            self._feed(name, self.config.zones_of(name), self.config)
        self._clocks += [
            asyncio.create_task(keep_time(self.zones)),
            asyncio.create_task(watch_clock(self._plumbing.clock)),
        ]

    async def stop_feeds(self) -> None:
        """No reading comes any more."""
        await asyncio.gather(end(self._clocks), self._weather.stop(), *(feed.stop() for feed in self._feeds))

    async def drain(self) -> None:
        """Let the zones empty their mailboxes, within DRAIN_SECONDS, and write their checkpoints."""
        if await _drained(self._running.values(), DRAIN_SECONDS):
            _log.warning("stopping before every mailbox was empty; the journal holds the rest for the next start")

    async def reload(self, new: Config) -> Changes:
        """Go over to `new`; zones that are the same go on. Raises ReloadRefused, and then nothing has changed."""
        async with self._reloading:
            problems = obstacles(self.config, new, {name: zone.fingerprint for name, zone in self.zones.items()})
            if problems:
                raise ReloadRefused(problems)
            changes = compare(self.config, new)
            fresh = {table.id: self._built(table, new) for table in changes.fresh}
            added = {table.id: fresh[table.id] for table in changes.added}
            try:
                await self._prepare(added, changes.added, new)
                await asyncio.to_thread(self._declare, list(added))
            except ServiceError as error:
                await asyncio.to_thread(self._undeclare, list(added))
                raise ReloadRefused([str(error)]) from error
            try:
                await self._go_over(new, changes, fresh)
            except Exception as error:
                # Half of one configuration and half of another is nothing to go on with; a start makes it whole.
                if not self.broken.done():
                    self.broken.set_exception(error)
                raise
            return changes

    async def _go_over(self, new: Config, changes: Changes, fresh: Mapping[str, Zone]) -> None:
        """Do what nothing stands against any more; the zones in `fresh` start, of which those added are restored."""
        await self._retire(changes.leaving)
        await self._prepare({table.id: fresh[table.id] for table in changes.changed}, changes.changed, new)
        await asyncio.to_thread(self._undeclare, changes.removed)
        self.zones.replace({table.id: fresh.get(table.id) or self.zones[table.id] for table in new.zones})
        for name in fresh:
            self._start(name)
        self._surround(new)
        await self._weather.follow(new)
        await self._follow(self.config, new, changes)
        self.config = new

    def _surround(self, config: Config) -> None:
        """Tell every zone what `config` says of its inputs: a neighbour's change concerns also a zone that goes on."""
        for name, around in surroundings(config).items():
            self.zones[name].surroundings = around

    def _built(self, table: ZoneConfig, config: Config) -> Zone:
        mark, worker, plumbing = fingerprint(table), make_worker(table), self._plumbing
        neighbours = neighbourhood(config, table, plumbing.store.checkpoints)
        return Zone(table.id, table.estimator, mark, worker, plumbing, neighbours=neighbours)

    async def _prepare(self, zones: Mapping[str, Zone], tables: Iterable[ZoneConfig], config: Config) -> None:
        lasts = await asyncio.gather(*(zone.prepare() for zone in zones.values()))
        self._last |= dict(zip(zones, lasts, strict=True))
        for table in tables:
            live, zone = config.goes_live(table), zones[table.id]
            alignment = make_alignment(table, self._last[table.id], live, zone.empty_samples)
            zone.align(alignment, live, config.pace_of(table))
            if live:
                # Before time passes: what was accepted must not find its interval closed.
                await zone.intake.recall()

    def _start(self, name: str) -> None:
        zone = self.zones[name]
        worker = asyncio.create_task(zone.run(), name=f"zone {name}")
        worker.add_done_callback(self._ended)
        self._running[name] = _Running(zone, worker)

    def _ended(self, worker: asyncio.Task[None]) -> None:
        if not worker.cancelled() and (error := worker.exception()) is not None and not self.broken.done():
            self.broken.set_exception(error)

    async def _retire(self, names: Collection[str]) -> None:
        """Stop these zones, with a checkpoint; nothing comes for them any more."""
        for feed in self._feeds:
            if not self.config.is_live(feed.name):
                feed.leave(names)
        retiring = [self._running.pop(name) for name in names]
        if await _drained(retiring, RETIRE_SECONDS):
            _log.warning("a zone that the reload stops is slow; the journal holds what it has not assimilated")

    async def _follow(self, old: Config, new: Config, changes: Changes) -> None:
        """Let the sources be those of `new`, and deliver to its zones."""
        fresh = {table.id for table in changes.fresh}
        for feed in self.feeds:
            served = [zone.id for zone in new.zones_of(feed.name)]
            live = old.is_live(feed.name)
            if not served or feed.name in changes.sources or (live and feed.over) or not (live or feed.served):
                self._feeds.remove(feed)
                await feed.stop()
            elif live:
                feed.rebind(new, served)
        at_work = {feed.name for feed in self._feeds}
        for name in new.sources:
            zones = new.zones_of(name)
            if name in at_work:
                # One connection to a live source is enough; of a recording everybody reads at a place of their own.
                zones = () if new.is_live(name) else tuple(zone for zone in zones if zone.id in fresh)
            self._feed(name, zones, new)
        for name in set(self.tallies) - set(new.sources):
            del self.tallies[name]

    def _feed(self, name: str, served: Collection[ZoneConfig], config: Config) -> None:
        """Let a source deliver to the zones `served`, a recording from where the first of them stopped."""
        if not served:
            return
        nexts = [None if (time := self._last[zone.id]) is None else time + zone.period for zone in served]
        start = None if None in nexts else min(time for time in nexts if time is not None)
        tally = self.tallies.setdefault(name, Tally())
        feed = Feed(name, config, self.zones, [zone.id for zone in served], tally)
        self._feeds.append(feed)
        feed.start(start)

    def _declare(self, names: Iterable[str]) -> None:
        for name in names:
            for sink in self._plumbing.sinks:
                sink.add(name)

    def _undeclare(self, names: Iterable[str]) -> None:
        for name in names:
            for sink in self._plumbing.sinks:
                sink.remove(name)


async def _drained(zones: Collection[_Running], seconds: float) -> bool:
    """Let zones empty their mailboxes and write their checkpoints; whether `seconds` were not enough. Then each ends
    after its present sample."""
    if not zones:
        return False
    workers = [running.worker for running in zones]
    closing = [asyncio.create_task(running.zone.intake.close()) for running in zones]
    _, late = await asyncio.wait([*workers, *closing], timeout=seconds)
    hurried = bool(late)
    if late:
        for running in zones:
            running.zone.hurry()
        _, late = await asyncio.wait(late, timeout=SAVE_SECONDS)
    for task in late:
        task.cancel()
    for result in await asyncio.gather(*workers, *closing, return_exceptions=True):
        if isinstance(result, Exception):
            raise result
    return hurried
