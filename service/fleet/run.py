"""`thermogate fleet run`: lets there be a steward, and stands for the fleet towards whoever started it.

The fleet goes on without this process: one that is started again finds it. SIGTERM and SIGINT stop it in order, SIGHUP
reads the configuration again.
"""

from __future__ import annotations

import asyncio
import logging
import signal
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from service.config.site import Config
from service.daemon.exposure import check_exposure
from service.daemon.logs import configure_logging
from service.daemon.notify import Notifier
from service.errors import ConfigError, ReloadRefused, ServiceError
from service.fleet.checks import fleet_of
from service.fleet.joining import join, leave
from service.fleet.sharding import lopsided

if TYPE_CHECKING:
    from service.fleet.steward import FleetStatus

ASK_SECONDS = 60.0

_AGAIN = 0.5
"""Pause before a steward that could not be reached is asked again, s."""

_log = logging.getLogger(__name__)


def run_fleet(config: Config, address: str | None, reread: Callable[[], Config]) -> int:
    """Run the fleet of `config` on the cluster at `address`, or one of its own, until it is told to stop; 0 after an
    orderly stop. Raises ServiceError."""
    check_exposure(config)
    configure_logging(config.log)
    for warning in (*config.warnings, *lopsided(config, fleet_of(config).shards)):
        _log.warning("configuration: %s", warning)
    join(address, alone=address is None)
    try:
        asyncio.run(_Running(config, reread).run())
    finally:
        leave()
    return 0


def ask_steward(site: str, address: str | None, method: str, *arguments: Any) -> Any:
    """What the steward of a running fleet answers. Raises ServiceError."""
    join(address)
    try:
        return asyncio.run(_asked(site, method, *arguments))
    finally:
        leave()


def watch_steward(site: str, address: str | None, every: float, show: Callable[[FleetStatus], None]) -> None:
    """Show the state of a running fleet every so many s, until interrupted; while it does not answer, say so."""

    async def watch() -> None:
        while True:
            try:
                show(await _asked(site, "status"))
            except ServiceError as error:
                _log.warning("%s", error)
            await asyncio.sleep(every)

    join(address)
    try:
        asyncio.run(watch())
    finally:
        leave()


async def _asked(site: str, method: str, *arguments: Any) -> Any:
    from service.errors import Away
    from service.fleet.peers import STEWARD, Peer

    try:
        return await Peer(site, STEWARD).ask(method, *arguments, timeout=ASK_SECONDS)
    except Away as error:
        raise ServiceError(
            f"no fleet of the site '{site}' answers on this cluster ({error}); start it with `thermogate fleet run`"
        ) from error


class _Running:
    """The life of the command."""

    def __init__(self, config: Config, reread: Callable[[], Config]) -> None:
        from service.fleet.peers import STEWARD, Peer

        self._config, self._reread = config, reread
        self._steward = Peer(config.site.id, STEWARD)
        self._stopping = asyncio.Event()
        self._reload = asyncio.Event()
        self._notifier = Notifier()

    async def run(self) -> None:
        """Start or find the fleet, and serve signals until the end."""
        from service.fleet import peers

        loop = asyncio.get_running_loop()
        for signum in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(signum, self._stopping.set)
        loop.add_signal_handler(signal.SIGHUP, self._reload.set)
        await asyncio.to_thread(peers.create, "steward", self._config.site.id, peers.STEWARD)
        done = await self._patiently("run", self._config)
        _log.info("the fleet runs: %s", done)
        self._notifier.ready("the fleet runs")
        stop = asyncio.create_task(self._stopping.wait())
        asked = asyncio.create_task(self._hear_of_reloads())
        while not stop.done():
            reload = asyncio.create_task(self._reload.wait())
            await asyncio.wait({stop, reload}, return_when=asyncio.FIRST_COMPLETED)
            if reload.done():
                self._reload.clear()
                await self._read_again()
            reload.cancel()
        asked.cancel()
        self._notifier.stopping()
        _log.info("the fleet is being stopped")
        await self._patiently("stop", timeout=None)
        await asyncio.to_thread(peers.remove, self._config.site.id, peers.STEWARD)
        _log.info("stopped")

    async def _read_again(self) -> None:
        done, problems = None, list[str]()
        try:
            new = await asyncio.to_thread(self._reread)
            fleet_of(new)
            done = await self._steward.ask("run", new)
            _log.info("configuration reloaded: %s", done)
        except (ConfigError, ReloadRefused) as error:
            problems = error.problems
        except ServiceError as error:
            problems = [str(error)]
        for problem in problems:
            _log.error("the configuration was not reloaded: %s", problem)
        with suppress(ServiceError):
            await self._steward.ask("reloaded", done, problems)

    async def _hear_of_reloads(self) -> None:
        """Notice, for ever, that a client has asked a gateway for a reload."""
        while True:
            try:
                if await self._steward.ask("reload_wanted"):
                    self._reload.set()
            except ServiceError:
                await self._let_there_be_a_steward()
                await asyncio.sleep(_AGAIN)

    async def _let_there_be_a_steward(self) -> None:
        """Ray starts a steward anew until its start fails once; then it has to be created again."""
        from service.fleet import peers

        try:
            await asyncio.to_thread(peers.create, "steward", self._config.site.id, peers.STEWARD)
        except Exception as error:
            # The head of the cluster may be away as well.
            _log.warning("there is no steward, and none can be created now: %r", error)

    async def _patiently(self, method: str, *arguments: Any, timeout: float | None = ASK_SECONDS) -> Any:
        """What the steward answers, once its process is there."""
        from service.errors import Away

        deadline = asyncio.get_running_loop().time() + ASK_SECONDS
        while True:
            try:
                return await self._steward.ask(method, *arguments, timeout=timeout)
            except Away:
                if asyncio.get_running_loop().time() > deadline:
                    raise
                await self._let_there_be_a_steward()
                await asyncio.sleep(_AGAIN)
