"""`thermogate fleet run`: keeps the plan, lets there be the members that it asks for, and ends those that hang.

The fleet goes on without this process: one that is started again finds it. SIGTERM and SIGINT stop it in order, SIGHUP
reads the configuration again.
"""

import asyncio
import logging
import signal
import time
from collections.abc import Callable
from contextlib import suppress

from service.config.site import Config
from service.daemon.exposure import check_exposure
from service.daemon.logs import configure_logging
from service.daemon.notify import Notifier
from service.daemon.reload import compare, summary, unchangeable
from service.errors import ConfigError, ReloadRefused, ServiceError
from service.fleet import peers
from service.fleet.checks import fleet_of
from service.fleet.messages import Beat
from service.fleet.peers import ANSWER_SECONDS, Peer
from service.fleet.plan import Plan
from service.fleet.sharding import lopsided
from service.pauses import within

LOOK = 0.5
"""How often the members are looked after, s."""
STOP_SECONDS = 30.0
"""How long an orderly stop waits for each kind of member."""
FORGIVEN = 600.0
"""s that a member may start, and after which, without another ending, it counts as one that never hung."""
_ANEW = "stop the fleet and start it again"
_KEPT_TABLES = ("site", "http", "zenoh", "fleet")
"""Tables of which the members go by what they were started with."""

_log = logging.getLogger(__name__)


def run_fleet(config: Config, address: str, reread: Callable[[], Config]) -> int:
    """Run the fleet of `config` on the cluster at `address` until it is told to stop; 0 after an orderly stop. Raises
    ServiceError."""
    check_exposure(config)
    configure_logging(config.log)
    for warning in (*config.warnings, *lopsided(config, fleet_of(config).shards)):
        _log.warning("configuration: %s", warning)
    with peers.joined(address):
        asyncio.run(Steward(config.site.id, reread).run(config))
    return 0


class Steward:
    """The life of the command. It goes on with the plan that the cluster keeps."""

    def __init__(self, site: str, reread: Callable[[], Config]) -> None:
        self._site, self._reread = site, reread
        self._plan: Plan | None = None
        self._beats: dict[str, Beat] = {}
        """The last sign of life of each member."""
        self._silent: dict[str, float] = {}
        """How long each member has been waited for in vain, s."""
        self._ended: dict[str, tuple[int, float]] = {}
        """How often each member was ended in a row, and when last (monotonic s)."""
        self._starting: set[str] = set()
        """Members that were ended, and have not been heard since."""
        self._peers: dict[str, Peer] = {}
        self._hearing: dict[str, asyncio.Task[None]] = {}
        self._stopping, self._reload = asyncio.Event(), asyncio.Event()

    async def run(self, config: Config) -> None:
        """Start or find the fleet, and look after it until a signal ends it."""
        loop, notifier = asyncio.get_running_loop(), Notifier()
        for signum in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(signum, self._stopping.set)
        loop.add_signal_handler(signal.SIGHUP, self._reload.set)
        self._plan = await asyncio.to_thread(peers.remembered, self._site)
        _log.info("the fleet runs: %s", await self.go_over(config))
        notifier.ready("the fleet runs")
        while not await within(self._stopping, LOOK):
            try:
                if self._reload.is_set() or any(beat.reload_wanted for beat in self._beats.values()):
                    self._reload.clear()
                    await self._read_again()
                await self.look()
            except Exception as error:
                _log.error("the fleet could not be looked after: %r", error, exc_info=_log.isEnabledFor(logging.DEBUG))
        notifier.stopping()
        _log.info("the fleet is being stopped")
        await self.stop()
        _log.info("stopped")

    async def go_over(self, config: Config) -> str:
        """Run the zones of `config` from now on; what that changes, as one line. Raises ReloadRefused."""
        before, shards = self._plan, fleet_of(config).shards
        done = f"{len(config.zones)} zones on {shards} shards"
        if before is not None:
            if problems := unchangeable(before.config, config, _KEPT_TABLES, "fleet.shards", _ANEW):
                raise ReloadRefused(problems)
            if before.config == config:
                return "nothing has changed"
            if shards == fleet_of(before.config).shards:
                done = summary(compare(before.config, config))
        plan = Plan(1 if before is None else before.version + 1, config)
        await asyncio.to_thread(peers.remember, self._site, plan)
        self._plan = plan
        return done

    async def look(self) -> None:
        """Look after every member once."""
        plan = self._plan
        assert plan is not None, "there is one from the start"
        nodes = await asyncio.to_thread(peers.nodes)
        wanted = peers.wanted(plan, nodes)
        present = await asyncio.to_thread(peers.members, self._site)
        for name, node in wanted.items():
            if name not in present:
                # Ray starts a process anew until its constructor fails; after that not even the name is left.
                cpus = 0.0 if node else fleet_of(plan.config).shard_cpus
                await asyncio.to_thread(peers.create, self._site, name, cpus, node)
            # One that does not answer must not keep the others waiting.
            if name not in self._hearing:
                self._hearing[name] = asyncio.create_task(self.hear(name, plan.version))
        for name in present - wanted.keys():
            _log.info("%s is not wanted any more", name)
            if name.startswith(peers.GATEWAY):
                # Its machine is lost.
                await asyncio.to_thread(peers.remove, self._site, name)
            else:
                await self._stopped(name)
            self._starting.discard(name)
            for known in (self._beats, self._silent, self._ended):
                known.pop(name, None)
        await self.end_the_hung(nodes)

    async def hear(self, name: str, version: int) -> None:
        """Hear a sign of life of a member, which goes by the plan of this `version` then."""
        asked = time.monotonic()
        try:
            beat: Beat = await self._peer(name).ask("beat", version, timeout=ANSWER_SECONDS)
        except ServiceError:
            # What is waited for, and not the time: this process itself may have stood still meanwhile.
            waited = min(time.monotonic() - asked, ANSWER_SECONDS)
            self._silent[name] = self._silent.get(name, 0.0) + waited
            return
        finally:
            self._hearing.pop(name, None)
        self._silent.pop(name, None)
        self._starting.discard(name)
        if self._beats.get(name, beat).boot != beat.boot:
            _log.warning("%s was started anew", name)
        self._beats[name] = beat

    async def end_the_hung(self, nodes: dict[str, str]) -> None:
        """End the members that were asked in vain for long although their machine lives: Ray starts them anew. A
        machine with too much to do looks like one that hangs, so a start may take long, and who was ended before has
        twice the time."""
        assert self._plan is not None
        patience, now = 3 * fleet_of(self._plan.config).lease + ANSWER_SECONDS, time.monotonic()
        for name, silent in list(self._silent.items()):
            if name not in self._beats or self._beats[name].node not in nodes:
                continue
            times, last = self._ended.get(name, (0, now))
            if now - last > FORGIVEN:
                times = 0
            if silent > (FORGIVEN if name in self._starting else patience * 2**times):
                _log.error("%s has not answered for %.0f s, and is started anew", name, silent)
                await asyncio.to_thread(peers.remove, self._site, name, for_good=False)
                self._ended[name] = times + 1, now
                self._starting.add(name)
                self._silent[name] = 0.0

    async def stop(self) -> None:
        """Stop every member in order, and forget the plan: the shards after their last sample, then the gateways."""
        present = await asyncio.to_thread(peers.members, self._site)
        gateways = {name for name in present if name.startswith(peers.GATEWAY)}
        for names in (present - gateways, gateways):
            await asyncio.gather(*(self._stopped(name) for name in names))
        # Were this process lost before, the next one would find here what is left to stop.
        await asyncio.to_thread(peers.forget, self._site)

    async def _stopped(self, name: str) -> None:
        with suppress(ServiceError):
            await self._peer(name).ask("stop", timeout=STOP_SECONDS)
        await asyncio.to_thread(peers.remove, self._site, name)

    async def _read_again(self) -> None:
        """Read the configuration, and tell the gateways whose clients want that."""
        done, problems = "", list[str]()
        try:
            config = await asyncio.to_thread(self._reread)
            fleet_of(config)
            done = await self.go_over(config)
            _log.info("configuration reloaded: %s", done)
        except (ConfigError, ReloadRefused) as error:
            problems = error.problems
        except ServiceError as error:
            problems = [str(error)]
        for problem in problems:
            _log.error("the configuration was not reloaded: %s", problem)
        for name, beat in self._beats.items():
            if beat.reload_wanted:
                self._beats[name] = beat._replace(reload_wanted=False)
                with suppress(ServiceError):
                    await self._peer(name).ask("reloaded", done, problems, timeout=ANSWER_SECONDS)

    def _peer(self, name: str) -> Peer:
        return self._peers.setdefault(name, Peer(self._site, name))
