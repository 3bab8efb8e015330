"""`thermogate fleet run`: lets there be a steward, and stands for the fleet towards whoever started it.

The fleet goes on without this process: one that is started again finds it. SIGTERM and SIGINT stop it in order, SIGHUP
reads the configuration again.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.config.site import Config
from service.daemon.exposure import check_exposure
from service.daemon.logs import configure_logging
from service.daemon.notify import Notifier
from service.errors import ConfigError, ReloadRefused, ServiceError
from service.fleet.checks import fleet_of

if TYPE_CHECKING:
    from service.fleet.steward import FleetStatus

OBJECT_STORE = 80 * 2**20
"""Shared memory of a cluster on one machine, bytes: what members send each other is small."""

ASK_SECONDS = 60.0

_ADDRESS = "address"
"""The file with the address of the cluster that a run has started on this machine alone."""

_QUIET = {
    # Ray would tell its makers that it is used, and paint the lines of others.
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_COLOR_PREFIX": "0",
    "RAY_DEDUP_LOGS": "0",
    # A machine that is lost is noticed after this many missed signs of life, s and their number.
    "RAY_health_check_initial_delay_ms": "2000",
    "RAY_health_check_period_ms": "1000",
    "RAY_health_check_timeout_ms": "2000",
    "RAY_health_check_failure_threshold": "3",
}

_log = logging.getLogger(__name__)


def run_fleet(config: Config, address: str | None, reread: Callable[[], Config]) -> int:
    """Run the fleet of `config` on the cluster at `address`, or one of its own, until it is told to stop; 0 after an
    orderly stop. Raises ServiceError."""
    check_exposure(config)
    configure_logging(config.log)
    for warning in config.warnings:
        _log.warning("configuration: %s", warning)
    fleet_of(config)
    _join(address, alone=address is None)
    try:
        asyncio.run(_Running(config, reread).run())
    finally:
        _leave()
    return 0


def ask_steward(site: str, address: str | None, method: str, *arguments: Any) -> Any:
    """What the steward of a running fleet answers. Raises ServiceError."""
    _join(address)
    try:
        return asyncio.run(_asked(site, method, *arguments))
    finally:
        _leave()


def watch_steward(site: str, address: str | None, every: float, show: Callable[[FleetStatus], None]) -> None:
    """Show the state of a running fleet every so many s, until interrupted; while it does not answer, say so."""

    async def watch() -> None:
        while True:
            try:
                show(await _asked(site, "status"))
            except ServiceError as error:
                _log.warning("%s", error)
            await asyncio.sleep(every)

    _join(address)
    try:
        asyncio.run(watch())
    finally:
        _leave()


async def _asked(site: str, method: str, *arguments: Any) -> Any:
    from service.fleet.messages import Away
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
        while not stop.done():
            reload = asyncio.create_task(self._reload.wait())
            await asyncio.wait({stop, reload}, return_when=asyncio.FIRST_COMPLETED)
            if reload.done():
                self._reload.clear()
                await self._read_again()
            reload.cancel()
        self._notifier.stopping()
        _log.info("the fleet is being stopped")
        await self._steward.ask("stop")
        await asyncio.to_thread(peers.remove, self._config.site.id, peers.STEWARD)
        _log.info("stopped")

    async def _read_again(self) -> None:
        try:
            new = await asyncio.to_thread(self._reread)
            fleet_of(new)
            done = await self._steward.ask("run", new)
            _log.info("configuration reloaded: %s", done)
        except (ConfigError, ReloadRefused) as error:
            for problem in error.problems:
                _log.error("the configuration was not reloaded: %s", problem)
        except ServiceError as error:
            _log.error("the configuration was not reloaded: %s", error)

    async def _patiently(self, method: str, *arguments: Any) -> Any:
        """What the steward answers, once its process is there."""
        from service.fleet.messages import Away

        deadline = asyncio.get_running_loop().time() + ASK_SECONDS
        while True:
            try:
                return await self._steward.ask(method, *arguments, timeout=ASK_SECONDS)
            except Away:
                if asyncio.get_running_loop().time() > deadline:
                    raise
                await asyncio.sleep(0.5)


def _join(address: str | None, alone: bool = False) -> None:
    """Join the cluster at `address`, or start one of this machine `alone`; None: the one that was started so, or any
    that is on this machine."""
    for name, value in _QUIET.items():
        os.environ.setdefault(name, value)
    folder = Path(tempfile.gettempdir()) / f"thermogate-ray-{os.getuid()}"
    known = folder / _ADDRESS
    if address is None and not alone and known.exists():
        address = known.read_text(encoding="utf-8")
    if alone or (address or "").startswith("127.0.0.1:"):
        # Ray otherwise takes any other address of this machine, and listens on all of them.
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    import ray

    options: dict[str, Any] = {"log_to_driver": alone, "configure_logging": False, "logging_level": logging.ERROR}
    if alone:
        folder.mkdir(mode=0o700, exist_ok=True)
        options |= {"include_dashboard": False, "object_store_memory": OBJECT_STORE, "_temp_dir": str(folder)}
    else:
        options["address"] = address or "auto"
    try:
        ray.init(**options)
    except (ConnectionError, ValueError, RuntimeError) as error:
        first = str(error).splitlines()[0]
        raise ServiceError(
            f"the Ray cluster {address or 'of this machine'} cannot be joined ({first}); start one with `ray start "
            "--head`, or name another with --address"
        ) from error
    if alone:
        known.write_text(ray.get_runtime_context().gcs_address, encoding="utf-8")


def _leave() -> None:
    import ray

    ray.shutdown()
    sys.stdout.flush()
