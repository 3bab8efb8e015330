"""The steward: keeps the plan, lets there be the members that it asks for, and ends those that hang."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Collection, Iterable, Mapping
from contextlib import suppress
from typing import NamedTuple

from service.config.fleet import FleetConfig
from service.config.site import Config
from service.daemon.logs import configure_logging
from service.daemon.reload import compare, summary, unchangeable
from service.errors import ReloadRefused, ServiceError
from service.fleet import peers
from service.fleet.messages import Beat
from service.fleet.peers import STEWARD, Peer
from service.fleet.plan import Plan, shard_names
from service.pauses import within

LOOK = 0.5
"""How often the members are looked after, s."""

ANSWER_SECONDS = 5.0

RELOAD_SECONDS = 30.0
"""How long a reload that a client asks for waits for `thermogate fleet run`, which has the configuration."""

STOP_SECONDS = 30.0
"""How long an orderly stop waits for each kind of member."""

_GATEWAY = "gateway-"

_ANEW = "stop the fleet and start it again"
_KEPT_TABLES = ("site", "http", "zenoh", "fleet")
"""Tables of which the members go by what they were started with."""

_log = logging.getLogger(__name__)


class Known(NamedTuple):
    """A member, and when it last gave a sign of life, monotonic s; None: not since it is looked for."""

    beat: Beat
    at: float


class FleetStatus(NamedTuple):
    """How the fleet is doing."""

    version: int
    moving: int
    """Zones that are between two shards."""
    nodes: Mapping[str, str]
    members: tuple[tuple[str, Beat | None, float], ...]
    """Every member that there should be: its name, its last sign of life, and how long ago that was, s."""
    quarantined: tuple[str, ...]


class Steward:
    """The body of the steward. A new process of it goes on with the plan that the cluster keeps."""

    def __init__(self, site: str, name: str) -> None:
        self._site = site
        self._plan: Plan | None = None
        self._known: dict[str, Known] = {}
        self._peers: dict[str, Peer] = {}
        self._hearing: dict[str, asyncio.Task[None]] = {}
        self._silent: dict[str, float] = {}
        """How long each member has been waited for in vain, s."""
        self._telling: dict[str, asyncio.Task[None]] = {}
        self._nodes: dict[str, str] = {}
        self._looking: asyncio.Task[None] | None = None
        self._stopping = False
        self._changing = asyncio.Lock()
        self._reloads: list[asyncio.Future[str]] = []
        """Reloads that clients asked for and nobody has done yet."""
        self._asked_to_reload = asyncio.Event()

    async def wake(self) -> None:
        """Go on with the plan of before, if there was one."""
        if (kept := await asyncio.to_thread(peers.remembered, self._site)) is not None:
            self._plan = kept
            configure_logging(self._plan.config.log)
            _log.info("the steward goes on with plan %d", self._plan.version)
        self._looking = asyncio.create_task(self._look_after())

    async def run(self, config: Config) -> str:
        """Run the zones of `config` from now on; what that changes, as one line. Raises ReloadRefused."""
        async with self._changing:
            before = self._plan
            if before is None:
                configure_logging(config.log)
                await self._go_by(Plan(1, config, shard_names(_fleet(config).shards)))
                return f"{len(config.zones)} zones on {_fleet(config).shards} shards"
            if problems := unchangeable(before.config, config, _KEPT_TABLES, "fleet.shards", _ANEW):
                raise ReloadRefused(problems)
            changes = compare(before.config, config)
            shards = None
            if _fleet(config).shards != _fleet(before.config).shards:
                shards = shard_names(_fleet(config).shards)
            if before.config != config:
                await self._go_by(before.followed_by(config, shards))
            return summary(changes)

    async def reload(self) -> str:
        """Have the configuration read again where it is; what that changed, as one line. Raises ReloadRefused."""
        done: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._reloads.append(done)
        self._asked_to_reload.set()
        try:
            async with asyncio.timeout(RELOAD_SECONDS):
                return await done
        except TimeoutError:
            raise ReloadRefused(
                [
                    f"`thermogate fleet run`, which reads the configuration, has not done so for {RELOAD_SECONDS:.0f} "
                    "s; see that it runs and what its log says, and ask again"
                ]
            ) from None
        finally:
            if done in self._reloads:
                self._reloads.remove(done)

    async def reload_wanted(self) -> bool:
        """Whether a client has asked for a reload, as soon as one does, or after a while."""
        await within(self._asked_to_reload, RELOAD_SECONDS / 3)
        self._asked_to_reload.clear()
        return bool(self._reloads)

    async def reloaded(self, done: str | None, problems: list[str]) -> None:
        """The reload that clients asked for is `done`, or None: refused for these `problems`."""
        asked, self._reloads = self._reloads, []
        for each in asked:
            if each.done():
                continue
            if done is None:
                each.set_exception(ReloadRefused(problems))
            else:
                each.set_result(done)

    async def rebalance(self, shards: int) -> str:
        """Spread the zones over so many shards; how many zones move. Raises ReloadRefused while the fleet starts.

        Also while zones move: the machines may not have the processors for the shards that are waited for.
        """
        async with self._changing:
            before = self._plan
            if before is None:
                raise ReloadRefused(["the fleet is starting; try again in a moment"])
            after = before.followed_by(shards=shard_names(shards))
            await self._go_by(after)
            return f"{len(after.moving)} of {len(after.config.zones)} zones move; {shards} shards"

    async def status(self) -> FleetStatus:
        """How the fleet is doing."""
        now, plan = time.monotonic(), self._plan
        names = [] if plan is None else self._wanted(plan)
        members = tuple(
            (name, self._present(known.beat), now - known.at) if (known := self._known.get(name)) else (name, None, 0.0)
            for name in names
        )
        if plan is None:
            return FleetStatus(0, 0, dict(self._nodes), (), ())
        return FleetStatus(plan.version, len(plan.moving), dict(self._nodes), members, tuple(sorted(plan.quarantined)))

    def _present(self, beat: Beat) -> Beat:
        """The last sign of life of a member as far as it still holds: one that does not answer is not ready."""
        answers = beat.name not in self._silent and beat.node in self._nodes
        return beat if answers else beat._replace(ready=False)

    async def stop(self) -> None:
        """Stop every member in order, and forget the plan: the shards after their last sample, then the gateways."""
        self._stopping = True
        if self._looking is not None:
            # A member that is being created would outlast the stop.
            await asyncio.wait([self._looking], timeout=STOP_SECONDS)
        plan, self._plan = self._plan, None
        if plan is not None:
            gateways = [name for name in self._wanted(plan) if name.startswith(_GATEWAY)]
            for names in (plan.all_shards, gateways):
                await asyncio.gather(*(self._stopped(name) for name in names))
        # Were this process lost before, the next one would find here what is left to stop.
        await asyncio.to_thread(peers.forget, self._site)

    async def _stopped(self, name: str) -> None:
        with suppress(ServiceError):
            await self._peer(name).ask("stop", timeout=STOP_SECONDS)
        await asyncio.to_thread(peers.remove, self._site, name)

    async def _go_by(self, plan: Plan) -> None:
        await asyncio.to_thread(peers.remember, self._site, plan)
        self._plan = plan

    async def _look_after(self) -> None:
        while not self._stopping:
            try:
                await self._look()
            except Exception as error:
                _log.error("the fleet could not be looked after: %r", error, exc_info=_log.isEnabledFor(logging.DEBUG))
            await asyncio.sleep(LOOK)

    async def _look(self) -> None:
        plan = self._plan
        if plan is None:
            return
        self._nodes = await asyncio.to_thread(peers.nodes)
        names = self._wanted(plan)
        present = await asyncio.to_thread(peers.members, self._site)
        for name in [name for name in names if name in self._known and name not in present]:
            # Ray starts a process anew until its constructor fails; after that not even the name is left.
            _log.error("%s could not be started anew; it is created again", name)
            self._known.pop(name)
        await asyncio.to_thread(self._create, plan, present)
        for name in names:
            # One that does not answer must not keep the others waiting.
            if name not in self._hearing:
                self._hearing[name] = asyncio.create_task(self._hear(name))
        await asyncio.gather(*(self._dismissed(name) for name in present - {*names, STEWARD}))
        await self._end_the_hung(plan)
        await self._tell(plan)
        async with self._changing:
            if plan is self._plan and not plan.moving and (poisoned := self._poisoned(plan)):
                for zone, why in poisoned.items():
                    _log.error("zone '%s' is quarantined: %s", zone, why)
                await self._go_by(plan.followed_by(quarantined=plan.quarantined | poisoned.keys()))
            elif plan is self._plan and plan.moving and self._has_adopted(plan, plan.all_shards):
                _log.info("%d zones have left their shards and go to others", len(plan.moving))
                await self._go_by(plan.settled())

    async def _dismissed(self, name: str) -> None:
        """End a member that is not wanted any more."""
        _log.info("%s is not wanted any more", name)
        if name.startswith(_GATEWAY):
            # Its machine is lost.
            await asyncio.to_thread(peers.remove, self._site, name)
        else:
            await self._stopped(name)
        if name in self._hearing:
            self._hearing.pop(name).cancel()
        self._known.pop(name, None)
        self._silent.pop(name, None)

    def _poisoned(self, plan: Plan) -> dict[str, str]:
        """Zones that brought down the process they are in, and how."""
        found = dict[str, str]()
        for shard in plan.shards:
            if shard in self._known:
                found |= self._known[shard].beat.guilty
        return {zone: why for zone, why in found.items() if zone not in plan.quarantined}

    def _wanted(self, plan: Plan) -> list[str]:
        """The members that there should be."""
        return [*(f"{_GATEWAY}{node[:8]}" for node in self._nodes), *plan.all_shards]

    def _create(self, plan: Plan, present: Collection[str]) -> None:
        """Let there be every member that is wanted and not `present`."""
        fleet = _fleet(plan.config)
        for node in self._nodes:
            if f"{_GATEWAY}{node[:8]}" not in present:
                peers.create("gateway", self._site, f"{_GATEWAY}{node[:8]}", node=node)
        for shard in plan.all_shards:
            if shard not in present:
                peers.create("shard", self._site, shard, fleet.shard_cpus)

    def _peer(self, name: str) -> Peer:
        return self._peers.setdefault(name, Peer(self._site, name))

    async def _hear(self, name: str) -> None:
        asked = time.monotonic()
        try:
            beat: Beat = await self._peer(name).ask("beat", timeout=ANSWER_SECONDS)
        except ServiceError:
            # What is waited for, and not the time: the steward itself may have stood still meanwhile.
            waited = min(time.monotonic() - asked, ANSWER_SECONDS)
            self._silent[name] = self._silent.get(name, 0.0) + waited
            return
        finally:
            self._hearing.pop(name, None)
        self._silent.pop(name, None)
        before = self._known.get(name)
        if before is not None and before.beat.boot != beat.boot:
            _log.warning("%s was started anew on %s", name, self._nodes.get(beat.node, "another machine"))
        self._known[name] = Known(beat, time.monotonic())

    async def _end_the_hung(self, plan: Plan) -> None:
        patience = 3 * _fleet(plan.config).lease + ANSWER_SECONDS
        for name, silent in list(self._silent.items()):
            known = self._known.get(name)
            if silent <= patience or known is None or known.beat.node not in self._nodes or name.startswith(_GATEWAY):
                continue
            _log.error("%s has not answered for %.0f s", name, silent)
            with suppress(ServiceError):
                await self._peer(f"{_GATEWAY}{known.beat.node[:8]}").ask("end", known.beat.pid, timeout=ANSWER_SECONDS)
            # Ray starts it anew; until then there is nobody to hear from.
            self._silent[name] = 0.0

    async def _tell(self, plan: Plan) -> None:
        """Tell the plan to every member that goes by another one."""
        shares = None
        for name in self._wanted(plan):
            known = self._known.get(name)
            if known is None or known.beat.version >= plan.version or name in self._telling:
                continue
            if name in plan.all_shards:
                shares = shares or plan.shares()
                work = self._peer(name).ask("adopt", plan.version, shares[name])
            else:
                work = self._peer(name).ask("adopt", plan)
            self._telling[name] = asyncio.create_task(self._told(name, work))

    async def _told(self, name: str, work: Awaitable[None]) -> None:
        try:
            await work
        except ServiceError as error:
            _log.error("%s cannot go by the plan yet: %s", name, error)
            await asyncio.sleep(LOOK)
        finally:
            self._telling.pop(name, None)

    def _has_adopted(self, plan: Plan, names: Iterable[str]) -> bool:
        """Whether all of these go by `plan`."""
        found = [self._known.get(name) for name in names]
        return all(known is not None and known.beat.version >= plan.version for known in found)


def _fleet(config: Config) -> FleetConfig:
    assert config.fleet is not None, "a configuration without [fleet] is refused before it comes here"
    return config.fleet
