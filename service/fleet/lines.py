"""The way of one source from the reader to the shards, and what is kept on it until it is durable there."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

from adapters.reading import Batch, Reading
from service.daemon.supply.feeding import feed
from service.daemon.tasks import end
from service.errors import Away, ServiceError
from service.fleet.messages import Ack
from service.fleet.plan import Plan
from service.pauses import within
from service.sources.routing import Delivery

if TYPE_CHECKING:
    from service.fleet.peers import Peer

ROOM = 64
"""Batches of a recording that may wait for a shard; then the recording waits."""

MOST_KEPT = 500_000
"""Readings of a live source that are kept at most; then the oldest are lost, and it is said."""

AGAIN = 0.3
"""Pause before a shard that could not be reached is asked again, s."""

LOOK = 1.0
"""How often a shard for which there is nothing is asked whether it was started anew, s."""

_log = logging.getLogger(__name__)


class _Kept(NamedTuple):
    """A batch, and the time of its newest reading."""

    batch: Batch
    newest: float


class Line:
    """The source `name` by `plan`, and its ends at the shards."""

    def __init__(self, name: str, plan: Plan, peer: Callable[[str], Peer], before: Line | None = None) -> None:
        """`before` is the line in whose place it comes: what a live source has delivered is not to be had again."""
        self.name = name
        self._peer = peer
        self._table, self._bindings = plan.config.sources[name], plan.config.bindings(name)
        self._source = plan.config.build_source(name)
        self._live = plan.config.is_live(name)
        self._over = False
        """Whether the source has come to its end, or stays off."""
        self._kept: deque[_Kept] = deque()
        self._readings = 0
        """How many readings are kept."""
        self._lost = 0
        if before is not None and before._live and self._live:
            self._kept, self._readings, self._lost = deque(before._kept), before._readings, before._lost
        self._ends: dict[str, _End] = {}
        self._held_from: float | None = None
        """The earliest time of which zones that are on their way to another shard may want something."""
        self._moving = False
        self.version = 0
        self.assign(plan)

    @property
    def zones(self) -> Sequence[str]:
        """The shards, which are to `feed` what zones are in the daemon."""
        return tuple(self._ends)

    def problems(self) -> list[str]:
        """What is wrong, one sentence each."""
        if not self._lost:
            return []
        return [
            f"sources.{self.name}: {self._lost} readings were given up, because shards did not take them for too long"
        ]

    def can_follow(self, plan: Plan) -> bool:
        """Whether it can go over to `plan` with the source that it reads: from the same table, and for the same
        channels unless it is live."""
        if plan.config.sources[self.name] != self._table:
            return False
        return (self._live and not self._over) or plan.config.bindings(self.name) == self._bindings

    def assign(self, plan: Plan) -> None:
        """Deliver as `plan` says from now on; it is one that the line can follow."""
        owner = plan.owners()
        channels: dict[str, set[str]] = {}
        bindings = plan.config.bindings(self.name)
        if bindings != self._bindings:
            plan.config.rebind_source(self.name, self._source)
            self._bindings = bindings
        for binding in bindings:
            zone = binding.id.split("/", 1)[0]
            if zone not in plan.moving:
                channels.setdefault(owner[zone], set()).add(binding.id)
        if plan.moving:
            # Who takes the moving zones over begins where those who had them stopped.
            floors = [held.durable for held in self._ends.values()]
            self._held_from = min(floors, default=-inf) if self._held_from is None else self._held_from
        for shard in set(self._ends) - set(channels):
            self._ends.pop(shard).cancel()
        for shard, asked in channels.items():
            if shard not in self._ends:
                self._ends[shard] = _End(self, self._peer(shard))
            self._ends[shard].ask_for(frozenset(asked), self._kept)
        self.version, self._moving = plan.version, bool(plan.moving)

    async def run(self) -> None:
        """Read until the source ends, and then stay for shards that are started anew."""
        position = None if self._live else await self._position()
        await feed(self._source, self, self._ends, position)
        self._over = True
        await asyncio.Event().wait()

    def split(self, batch: Batch) -> list[Delivery]:
        """Keep a batch, and owe it to every shard."""
        self._trim()
        kept = _Kept(batch, max((reading.time for reading in batch.readings), default=-inf))
        self._kept.append(kept)
        self._readings += len(batch.readings)
        for held in self._ends.values():
            held.owe(kept)
        while self._live and self._readings > MOST_KEPT:
            self._give_up(self._kept[0])
        return [Delivery(shard, self.name, [], batch.now) for shard in self._ends]

    def has_room(self, owed: int) -> bool:
        """Whether a shard to which so many batches are owed can be owed more; a live source does not wait."""
        return self._live or owed < ROOM

    async def close(self) -> None:
        """Stop delivering, and let go of the source."""
        for held in self._ends.values():
            held.cancel()
        await end([held.task for held in self._ends.values()])
        await self._source.close()

    async def _position(self) -> float | None:
        """Where a recording goes on: where the zone is that is furthest behind, of all zones: while some are on their
        way to another shard or to quarantine, nobody can tell where they are."""
        acks: dict[str, Ack] = {}
        while self._moving or not all(self._tells(acks.get(shard)) for shard in self._ends):
            for shard in tuple(self._ends):
                with suppress(ServiceError):
                    acks[shard] = await self._peer(shard).ask("position", self.name, "")
            await asyncio.sleep(AGAIN)
        times = [acks[shard].durable for shard in self._ends]
        known = [time for time in times if time is not None]
        return min(known) if known and len(known) == len(times) else None

    def _tells(self, ack: Ack | None) -> bool:
        """Whether a shard has told where all the zones are that it has by the plan."""
        return ack is not None and ack.version >= self.version and ack.durable != -inf

    def _trim(self) -> None:
        """Keep no longer what is durable wherever it is wanted."""
        if (
            self._held_from is not None
            and not self._moving
            and all(held.version >= self.version for held in self._ends.values())
        ):
            self._held_from = None
        floor = min((held.durable for held in self._ends.values()), default=-inf)
        if self._held_from is not None:
            floor = min(floor, self._held_from)
        owed = {id(kept) for held in self._ends.values() for kept in held.owed}
        while self._kept and self._kept[0].newest < floor and id(self._kept[0]) not in owed:
            self._readings -= len(self._kept.popleft().batch.readings)

    def _give_up(self, kept: _Kept) -> None:
        if not self._lost:
            _log.error("source '%s': shards do not take what it delivers; the oldest readings are given up", self.name)
        self._lost += len(kept.batch.readings)
        self._readings -= len(kept.batch.readings)
        self._kept.popleft()
        for held in self._ends.values():
            held.forgive(kept)


class _End:
    """What one shard is owed of a source; in order, again from the beginning for every new process of it."""

    def __init__(self, line: Line, peer: Peer) -> None:
        self.version = 0
        """Of the shard's plan."""
        self.durable = -inf
        self._line, self._peer = line, peer
        self._boot = ""
        self._channels: frozenset[str] = frozenset()
        self._owed: deque[tuple[_Kept, Collection[str], bool]] = deque()
        """Batches, the channels of each that the shard does not have yet, and whether its zones may have had them."""
        self._doubt = False
        self._finished = False
        self._told_end = False
        self._news, self._room = asyncio.Event(), asyncio.Event()
        self._kept: Iterable[_Kept] = ()
        self.task = asyncio.create_task(self._serve())

    @property
    def owed(self) -> list[_Kept]:
        """The batches that the shard does not have yet."""
        return [kept for kept, _, _ in self._owed]

    def ask_for(self, channels: frozenset[str], kept: Iterable[_Kept]) -> None:
        """The shard has these channels from now on; of those it did not have it gets all that is `kept`."""
        fresh, owed = channels - self._channels, {id(one): asked for one, asked, _ in self._owed}
        self._kept, self._channels = kept, channels
        # It may have built zones that have not heard of the end.
        self._told_end = False
        self._news.set()
        if fresh:
            self.durable = -inf
            # One clock for all channels: they come in the order in which they were read.
            self._owed = deque((one, frozenset(owed.get(id(one), ())) | fresh, True) for one in kept)

    def owe(self, kept: _Kept) -> None:
        """The shard gets a batch."""
        self._owed.append((kept, self._channels, False))
        self._news.set()

    def forgive(self, kept: _Kept) -> None:
        """The shard does not get a batch any more."""
        self._owed = deque(each for each in self._owed if each[0] is not kept)

    async def deliver(self, source: str, readings: Iterable[Reading], now: float) -> None:
        """Wait for room; what is delivered is owed already."""
        while not self._line.has_room(len(self._owed)):
            self._room.clear()
            await self._room.wait()

    async def end(self, source: str) -> None:
        """Tell the shard that nothing follows what it is owed."""
        self._finished = True
        self._news.set()

    async def source_failed(self, source: str, reason: str) -> None:
        """Tell the shard why there is nothing; one that is away hears it the next time."""
        with suppress(ServiceError):
            await self._peer.ask("trouble", source, reason, timeout=AGAIN)

    def cancel(self) -> None:
        """Deliver nothing any more."""
        self.task.cancel()

    async def _serve(self) -> None:
        while True:
            try:
                await self._next()
            except ServiceError as error:
                if not isinstance(error, Away):
                    _log.error("source '%s': %s", self._line.name, error)
                await asyncio.sleep(AGAIN)

    async def _next(self) -> None:
        """Hand over what comes next, or look after the shard where there is nothing."""
        name = self._line.name
        if self._owed:
            item = self._owed[0]
            kept, channels, again = item
            # What could not be taken the last time may have been in part.
            again, self._doubt = again or self._doubt, True
            batch = Batch([reading for reading in kept.batch.readings if reading.channel in channels], kept.batch.now)
            if self._heard(await self._ask("deliver", batch, again)) and self._owed and self._owed[0] is item:
                self._owed.popleft()
                self._doubt = False
                self._room.set()
        elif self._finished and not self._told_end:
            version = self._line.version
            heard = self._heard(await self._ask("finish"))
            self._told_end = heard and version == self._line.version
        else:
            self._heard(await self._peer.ask("position", name, self._boot, timeout=10 * LOOK))
            self._news.clear()
            if not self._owed:
                await within(self._news, LOOK)

    async def _ask(self, method: str, *arguments: Any) -> Ack:
        ack: Ack = await self._peer.ask(method, self._line.name, self._boot, self._line.version, *arguments)
        return ack

    def _heard(self, ack: Ack) -> bool:
        """Whether the shard is still the process that it was; another one is owed everything."""
        self.version, self.durable = ack.version, -inf if ack.durable is None else ack.durable
        if ack.boot == self._boot:
            return True
        self._boot, self._told_end = ack.boot, False
        self._owed = deque((kept, self._channels, True) for kept in self._kept)
        return False
