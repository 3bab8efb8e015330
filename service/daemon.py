"""`thermogate run`: everything started in order, stopped in order.

One asyncio loop does all I/O; estimator steps run in a thread pool (the compiled kernels release the GIL). On
SIGTERM or SIGINT the sources stop, the mailboxes are drained, checkpoints are written, HTTP and Zenoh are closed.
"""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
from typing import Any

from service.api import create_app
from service.config_models import Config
from service.errors import ServiceError
from service.exposure import check_exposure
from service.feeding import end, feed, keep_time, watch_clock
from service.fitting import channels_of, fingerprint, make_alignment, make_worker, zones_of
from service.http_measures import http_measures
from service.http_server import HttpServer
from service.keys import KeyRing
from service.logs import configure_logging
from service.loop_delay import watch_loop
from service.metrics import Metrics
from service.plumbing import Announcer, Plumbing
from service.publisher import Publisher
from service.retention import Limits
from service.routing import Router
from service.sources import build_source, is_live, pace_of
from service.store import Store
from service.streams import Streams
from service.zone import Zone

DRAIN_SECONDS = 2.0
"""How long a stop waits for the mailboxes; what is left is in the journal and assimilated at the next start."""

SAVE_SECONDS = 1.0
"""How long it then waits for the checkpoints."""

_COLLECT_AFTER = (5000, 10, 1000)
"""Thresholds of the garbage collector. A full collection holds every thread, for 60 ms with a thousand zones, and finds
next to nothing: what is thrown away here are no cycles. So it is rare."""

_SWITCH_SECONDS = 0.0005
"""After how long a thread hands on the interpreter lock that another one waits for. The event loop takes it back
several times for one answer; at Python's 5 ms each, REST would be slow whenever zones are stepped."""

_NICENESS = 5
"""Of the threads that compute; Linux keeps it per thread."""

_log = logging.getLogger(__name__)


def run_daemon(config: Config, *, reset: Sequence[str] = (), duration: float | None = None) -> int:
    """Run until SIGTERM or SIGINT, or for `duration` s; 0 after an orderly stop.

    `reset` names zones whose stored state is set aside first. Raises ServiceError where the start fails.
    """
    configure_logging()
    sys.setswitchinterval(_SWITCH_SECONDS)
    gc.set_threshold(*_COLLECT_AFTER)
    unknown = [name for name in reset if name not in {zone.id for zone in config.zones}]
    if unknown:
        known = ", ".join(zone.id for zone in config.zones)
        raise ServiceError(f"--reset {unknown[0]}: there is no such zone; the zones are {known}")
    check_exposure(config)
    asyncio.run(Daemon(config).run(reset, duration))
    return 0


class Daemon:
    """A running daemon; `run` is its whole life."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._stopping = asyncio.Event()
        self._stopped = threading.Event()

    async def run(self, reset: Sequence[str], duration: float | None) -> None:
        """Start, serve until asked to stop, stop."""
        loop = asyncio.get_running_loop()
        for signum in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(signum, self._stop)
        if duration is not None:
            loop.call_later(duration, self._stop)
        store = Store(self._config.site.state_dir)
        pool = ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="estimator", initializer=_stand_back)
        asking = ThreadPoolExecutor(1, thread_name_prefix="asking", initializer=_stand_back)
        publisher: Publisher | None = None
        try:
            for name in reset:
                await store.forget(name)
            if self._config.zenoh.enabled:
                site, zones = self._config.site.id, [zone.id for zone in self._config.zones]
                connection = self._config.zenoh.connection(site)
                publisher = await asyncio.to_thread(Publisher.open, connection, site, zones)
            await self._serve(store, pool, asking, publisher)
        finally:
            if publisher is not None:
                await asyncio.to_thread(publisher.close)
            for executor in (asking, pool):
                executor.shutdown(wait=True, cancel_futures=True)
            store.close()
        _log.info("stopped")

    def _stop(self) -> None:
        self._stopped.set()
        self._stopping.set()

    async def _serve(
        self, store: Store, pool: ThreadPoolExecutor, asking: ThreadPoolExecutor, publisher: Publisher | None
    ) -> None:
        zones: dict[str, Zone] = {}
        metrics = Metrics(zones, version("thermogate"))
        every = self._config.site.checkpoint_every
        streams = Streams(self._config.site.id)
        announcers: list[Announcer] = [streams] if publisher is None else [publisher, streams]
        plumbing = Plumbing(store, pool, asking, self._stopped, metrics, announcers, every)
        for table in self._config.zones:
            zones[table.id] = Zone(table.id, table.estimator, fingerprint(table), partial(make_worker, table), plumbing)
        http, release = self._config.http, version("thermogate")
        keys = KeyRing(self._config.keys_file, required=http.exposed)
        app = create_app(
            self._config.site.id, zones, metrics.registry, version=release, keys=keys, http=http, streams=streams
        )
        server = HttpServer(app, http)
        metrics.register(http_measures(server, app))
        stop = asyncio.create_task(self._stopping.wait())
        watching = asyncio.create_task(watch_loop(metrics.observe_loop_delay))
        tasks: list[asyncio.Task[None]] = []
        try:
            preparing = asyncio.gather(*(zone.prepare() for zone in zones.values()))
            if not await _before(stop, preparing):
                return
            last = dict(zip(zones, preparing.result(), strict=True))
            for table in self._config.zones:
                live = is_live(table, self._config)
                zones[table.id].align(make_alignment(table, last[table.id], live), live, pace_of(table, self._config))
            serving = asyncio.create_task(server.run())
            workers = [asyncio.create_task(zone.run()) for zone in zones.values()]
            try:
                await server.started(serving)
                if publisher is not None and self._config.zenoh.await_subscriber > 0:
                    waiting = asyncio.to_thread(publisher.await_subscriber, self._config.zenoh.await_subscriber)
                    if not await _before(stop, asyncio.ensure_future(waiting)):
                        return
                # What was made at the start stays; no collection need look through it.
                gc.freeze()
                tasks = [asyncio.create_task(self._feed(name, zones, last)) for name in self._config.sources]
                site = self._config.site
                limits = Limits(site.keep_history, site.max_journal)
                tasks.append(asyncio.create_task(store.keep_within(limits)))
                if any(is_live(table, self._config) for table in self._config.zones):
                    tasks += [asyncio.create_task(keep_time(zones)), asyncio.create_task(watch_clock(plumbing.clock))]
                await asyncio.wait([stop, serving, *workers], return_when=asyncio.FIRST_COMPLETED)
            finally:
                await end(tasks)
                # An open stream would keep the server from stopping; the clients come back after a pause.
                streams.end()
                await asyncio.gather(_drain(zones, workers), server.stop(serving))
        finally:
            stop.cancel()
            watching.cancel()
            server.close()

    async def _feed(self, name: str, zones: Mapping[str, Zone], last: Mapping[str, int | None]) -> None:
        """Run one source from where the zones it feeds stopped."""
        source = build_source(name, self._config)
        tables = zones_of(name, self._config)
        nexts = [None if (time := last[zone.id]) is None else time + zone.period for zone in tables]
        start = None if None in nexts else min(time for time in nexts if time is not None)
        try:
            await feed(source, Router(name, channels_of(name, self._config)), zones, start)
        finally:
            await source.close()


def _stand_back() -> None:
    """In a thread that computes: let the event loop go first where processors are short, so that REST stays prompt."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)


async def _before(stop: asyncio.Task[bool], work: asyncio.Future[Any]) -> bool:
    """Whether `work` was done before the daemon was asked to stop; then it is given up. Its failure is raised."""
    await asyncio.wait([stop, work], return_when=asyncio.FIRST_COMPLETED)
    if not work.done():
        work.cancel()
        return False
    work.result()
    return True


async def _drain(zones: Mapping[str, Zone], workers: Sequence[asyncio.Task[None]]) -> None:
    """Let the zones empty their mailboxes, within DRAIN_SECONDS, and write their checkpoints."""
    closing = [asyncio.create_task(zone.close_mailbox()) for zone in zones.values()]
    _, late = await asyncio.wait([*workers, *closing], timeout=DRAIN_SECONDS)
    if late:
        _log.warning("stopping before every mailbox was empty; the journal holds the rest for the next start")
        for zone in zones.values():
            zone.hurry()
        _, late = await asyncio.wait(late, timeout=SAVE_SECONDS)
    for task in late:
        task.cancel()
    for result in await asyncio.gather(*workers, *closing, return_exceptions=True):
        if isinstance(result, Exception):
            raise result
