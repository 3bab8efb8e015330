"""A running site, put together from a configuration, a store and sinks: the daemon has one, and so has every shard."""

import asyncio
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, AsyncExitStack, nullcontext
from importlib.metadata import version
from typing import Any

from service.config.site import Config
from service.daemon.instruments import instrument
from service.daemon.process import collect_garbage, stand_back
from service.daemon.runtime import Runtime
from service.daemon.tasks import end
from service.daemon.zone_table import Zones
from service.forecast.ahead import LookingAhead
from service.publish.kinds import SINK_KINDS
from service.publish.metrics import Metrics
from service.publish.sinks import Sink
from service.publish.zenoh import Publisher
from service.records.outlook import WeatherBook
from service.records.view import ZoneView
from service.store.journalling import JournalStore
from service.store.retention import Limits
from service.zone.plumbing import Plumbing
from service.zone.questions import THREADS, Questions
from service.zone.zone import Zone


class RunningSite:
    """The zones of a configuration at work on `store`: once those of `runtime` are restored and started, `feed`, `stop`
    and `close` in this order. Store and sinks are closed by whoever opened them."""

    def __init__(
        self,
        config: Config,
        store: JournalStore,
        sinks: Sequence[Sink],
        threads: int,
        stopping: threading.Event | None = None,
        stepping: Callable[[str, int], AbstractContextManager[None]] = lambda zone, time: nullcontext(),
    ) -> None:
        """`threads` step the zones. `stopping` is set when the process begins to stop, and `stepping` surrounds every
        step (`Plumbing`)."""
        self.zones: Zones[Zone] = Zones()
        self.metrics = Metrics(self.zones, version("thermogate"))
        self.pool = ThreadPoolExecutor(threads, thread_name_prefix="estimator", initializer=stand_back)
        self._asking = ThreadPoolExecutor(THREADS, thread_name_prefix="asking", initializer=stand_back)
        self._store = store
        self._stopping = stopping or threading.Event()
        self._watching: list[asyncio.Future[Any]] = []
        announced_to = (self.metrics, *sinks)
        self._ahead = LookingAhead(config.site.id, self.zones, announced_to)
        plumbing = Plumbing(
            config.site.id,
            store,
            self.pool,
            Questions(self._asking, self._stopping),
            self._stopping,
            self.metrics,
            (*announced_to, self._ahead.news),
            config.site.checkpoint_every,
            stepping=stepping,
            weather=WeatherBook(),
        )
        self.runtime = Runtime(config, self.zones, plumbing)
        instrument(self.metrics, self.runtime, store, announced_to)

    async def feed(self) -> None:
        """Let the sources deliver to zones that have started, and look after the store."""
        await self.runtime.start_feeds()
        site = self.runtime.config.site
        limits = Limits(site.keep_history, site.max_journal)
        forever = (self._store.keep_within(limits), self._store.watch(), collect_garbage(), self._ahead.run())
        self._watching += [asyncio.create_task(work) for work in forever]

    async def stop(self) -> None:
        """No reading comes any more, and the zones empty their mailboxes. What fails is raised after the rest."""
        self._stopping.set()
        async with AsyncExitStack() as rest:
            rest.push_async_callback(self.runtime.drain)
            rest.push_async_callback(self.runtime.stop_feeds)

    async def close(self) -> None:
        """End every thread and task; safe to call twice."""
        await end(self._watching)
        for executor in (self._asking, self.pool):
            executor.shutdown(wait=True, cancel_futures=True)


async def open_sinks(config: Config, opened: AsyncExitStack) -> list[Sink]:
    """The sinks that `config` wants, which `opened` closes. Raises ServiceError."""
    sinks: list[Sink] = []
    for kind in SINK_KINDS.values():
        sink = await asyncio.to_thread(kind.open, config.table(kind.name), config.site.id)
        if sink is not None:
            opened.push_async_callback(asyncio.to_thread, sink.close)
            sinks.append(sink)
    return sinks


async def answer_on_zenoh(
    sinks: Sequence[Sink],
    config: Config,
    zones: Mapping[str, ZoneView],
    allowed: Callable[[], bool] = lambda: True,
    of_site: bool = True,
) -> None:
    """Answer what is asked on Zenoh about `zones`, and `of_site`, while that is `allowed`. Raises ServiceError."""
    publishers = [sink for sink in sinks if isinstance(sink, Publisher)]
    if not publishers:
        return
    # The routes take long to import, and a shard without Zenoh does without them.
    from service.daemon.queries import Queries
    from service.web.app import create_questions

    questions = create_questions(config.site.id, zones, config.site.time_zone)
    queries = Queries(questions, asyncio.get_running_loop(), allowed)
    for publisher in publishers:
        await asyncio.to_thread(publisher.answer_with, queries.answer, of_site)
