"""`thermogate run`: everything started in order, reloaded, stopped in order.

One asyncio loop does all I/O; estimator steps run in a thread pool (the compiled kernels release the GIL). On
SIGTERM or SIGINT the sources stop, the mailboxes are drained, checkpoints are written, HTTP and Zenoh are closed. On
SIGHUP the configuration is read again. What runs is put together in `service.daemon.composition`.
"""

import asyncio
import faulthandler
import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Coroutine, Sequence
from contextlib import AsyncExitStack
from functools import partial
from typing import Any

from adapters.cancelling import in_thread
from service.config.kept import keep_configuration
from service.config.site import Config
from service.daemon.composition import RunningSite, answer_on_zenoh, open_sinks
from service.daemon.exposure import check_exposure
from service.daemon.kernel_cache import guard_kernel_cache
from service.daemon.logs import audited, configure_logging, sweep_log
from service.daemon.loop_delay import watch_loop
from service.daemon.notify import Notifier
from service.daemon.process import favour_the_event_loop
from service.daemon.reload import summary
from service.daemon.serving import Serving
from service.daemon.supply.ingest import Ingest
from service.daemon.tasks import done_before, end
from service.daemon.vitals import HUNG_SECONDS, JOURNAL_SECONDS, Organ, Vitals
from service.errors import CertificateError, ConfigError, ReloadRefused
from service.publish.sinks import Sink
from service.store.audit import AUDIT, about
from service.store.database import Result
from service.store.store import Store
from service.web.measures import http_measures

_log = logging.getLogger(__name__)


def run_daemon(
    config: Config,
    *,
    reset: Sequence[str] = (),
    duration: float | None = None,
    reread: Callable[[], Config] | None = None,
) -> int:
    """Run until SIGTERM or SIGINT, or for `duration` s; 0 after an orderly stop. The state of the zones in `reset` is
    set aside first; `reread` reads the configuration again for a reload. Raises ServiceError where the start fails."""
    check_exposure(config)
    configure_logging(config.log)
    _warn(config)
    # The watchdog of systemd ends a daemon that hangs with SIGABRT; the log then says where every thread was.
    if sys.__stderr__ is not None:
        faulthandler.enable(sys.__stderr__)
    favour_the_event_loop()
    guard_kernel_cache()
    asyncio.run(Daemon(config, reread).run(reset, duration))
    return 0


def _warn(config: Config) -> None:
    for warning in config.warnings:
        _log.warning("configuration: %s", warning)


class Daemon:
    """A running daemon; `run` is its whole life."""

    def __init__(self, config: Config, reread: Callable[[], Config] | None = None) -> None:
        self._config = config
        self._reread = reread
        self._stopping = asyncio.Event()
        self._stopped = threading.Event()
        self._notifier = Notifier()
        self._serving = Serving(config)
        self._site: RunningSite | None = None
        self._ready: str | None = None
        """What the service manager is told once everything runs."""
        self._reloads: set[asyncio.Task[Any]] = set()

    async def run(self, reset: Sequence[str], duration: float | None) -> None:
        """Start, serve until asked to stop, stop."""
        loop = asyncio.get_running_loop()
        for signum in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(signum, self._stop)
        loop.add_signal_handler(signal.SIGHUP, self._hang_up)
        if duration is not None:
            loop.call_later(duration, self._stop)
        async with AsyncExitStack() as rest:
            store = Store(self._config.site.state_dir)
            rest.callback(store.close)
            rest.enter_context(audited(self._config.site.state_dir))
            AUDIT.info("started", extra=about("started", "daemon"))
            rest.callback(AUDIT.info, "stopped", extra=about("stopped", "daemon"))
            for name in reset:
                await store.forget(name)
                AUDIT.warning("the state of zone '%s' is set aside", name, extra=about("reset", "daemon"))
            opened = await open_sinks(self._config, rest)
            await _keep(self._config)
            sinks = (*opened, *self._serving.sinks)
            self._site = RunningSite(self._config, store, sinks, os.cpu_count() or 1, self._stopped)
            rest.push_async_callback(self._site.close)
            await self._serve(self._site, store, opened, rest)

    async def reload(self) -> str:
        """Read the configuration again and go over to it; what was done. Raises ReloadRefused, and then nothing was."""
        # Whoever asked may go away meanwhile; a reload is not left half done for that.
        return await asyncio.shield(self._own(self._reload()))

    async def _reload(self) -> str:
        if self._reread is None or self._site is None or self._ready is None:
            why = "is still starting" if self._reread else "was not started from a configuration file"
            raise ReloadRefused([f"the daemon {why}, so there is nothing to reload"])
        self._notifier.reloading()
        try:
            # A file that it reads may be a pipe that nobody writes to.
            new = await in_thread(self._reread)
            self._serving.reload()
            changes = await self._site.runtime.reload(new)
            if changes.log:
                configure_logging(new.log)
            await _keep(new)
            done = summary(changes)
            AUDIT.info("configuration reloaded: %s", done, extra=about("reloaded", "daemon"))
            _warn(new)
            return done
        except ConfigError as error:
            raise ReloadRefused(error.problems) from error
        except CertificateError as error:
            raise ReloadRefused([str(error)]) from error
        finally:
            self._notifier.ready(self._ready)

    def _stop(self) -> None:
        self._stopped.set()
        self._stopping.set()

    def _hang_up(self) -> None:
        self._own(self._reload_said())

    def _own(self, work: Coroutine[Any, Any, Result]) -> asyncio.Task[Result]:
        """`work` as a task that the daemon ends when it stops."""
        task = asyncio.create_task(work)
        self._reloads.add(task)
        task.add_done_callback(self._reloads.discard)
        return task

    async def _reload_said(self) -> None:
        try:
            await self.reload()
        except ReloadRefused as error:
            for problem in error.problems:
                _log.error("the configuration was not reloaded: %s", problem)
        except Exception as error:
            _log.error("the configuration was not reloaded: %r", error, exc_info=_log.isEnabledFor(logging.DEBUG))

    async def _serve(self, site: RunningSite, store: Store, opened: Sequence[Sink], rest: AsyncExitStack) -> None:
        """Everything from the listening socket to the end, which `rest` brings about in order."""
        loop, runtime, serving = asyncio.get_running_loop(), site.runtime, self._serving
        organs = (
            Organ("the journal", partial(store.run, int), JOURNAL_SECONDS),
            Organ("the estimator's threads", lambda: loop.run_in_executor(site.pool, int), HUNG_SECONDS),
        )
        vitals = Vitals(site.zones, organs)
        server, app = serving.open(
            site.zones,
            site.metrics.registry,
            problems=lambda: [*vitals.problems(), *store.problems()],
            reload=self.reload,
            take=Ingest(lambda: runtime.feeds, lambda: runtime.is_posted_to).take,
        )
        rest.callback(server.close)
        site.metrics.register(http_measures(server, app))
        await answer_on_zenoh(opened, self._config, site.zones)
        stop = asyncio.create_task(self._stopping.wait())
        watching = (watch_loop(site.metrics.loop_delay.observe), vitals.run(partial(self._feed_watchdog, vitals)))
        rest.push_async_callback(end, [stop, *map(asyncio.create_task, watching)])
        await runtime.declare()
        if not await done_before(stop, asyncio.ensure_future(runtime.restore())):
            return
        runtime.start_zones()
        rest.push_async_callback(self._end, site)
        ended = await serving.start()
        settling = asyncio.gather(*(asyncio.to_thread(sink.settle) for sink in opened))
        if not await done_before(stop, settling):
            return
        # What was made at the start stays; no collection need look through it.
        gc.freeze()
        await site.feed()
        self._ready = f"serving on {server.url}"
        self._notifier.ready(self._ready)
        ends: list[asyncio.Future[Any]] = [stop, ended, runtime.broken]
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        self._notifier.stopping()
        if runtime.broken.done():
            runtime.broken.result()

    async def _end(self, site: RunningSite) -> None:
        await end(tuple(self._reloads))
        for result in await asyncio.gather(site.stop(), self._serving.stop(), return_exceptions=True):
            if isinstance(result, BaseException):
                raise result

    def _feed_watchdog(self, vitals: Vitals) -> None:
        sweep_log()
        problems = vitals.problems()
        if problems:
            zones = ", ".join(vitals.hung())
            _log.error("the daemon hangs: %s", "; ".join([*problems, *([f"zones {zones}"] if zones else [])]))
        elif self._ready is None:
            self._notifier.starting("restoring the zones", HUNG_SECONDS)
        else:
            self._notifier.alive()


async def _keep(config: Config) -> None:
    """Keep `config` beside the state. The daemon runs without; the commands that read the state then ask for it."""
    try:
        await asyncio.to_thread(keep_configuration, config)
    except OSError as error:
        _log.warning("the configuration cannot be kept in %s: %s", config.site.state_dir, error.strerror)
