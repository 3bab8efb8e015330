"""A zone as the daemon runs it, without the daemon: its store and threads, what it announces, steps that fail."""

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager

from support.waiting import until
from support.zone_samples import comparable, worker

from service.errors import ServiceError
from service.publish.metrics import Metrics
from service.publish.sinks import Occasion
from service.store.store import Store
from service.zone.plumbing import Plumbing
from service.zone.questions import Questions
from service.zone.zone import Zone


class Announced:
    """A sink that remembers, and can be told to fail."""

    def __init__(self):
        self.told, self.updates, self.states, self.broken = [], [], [], False

    def publish(self, announcement):
        if announcement.occasion is not Occasion.STATUS:
            if self.broken:
                raise ServiceError("[zenoh]: the session is gone")
            self.updates.append((announcement.zone, announcement.update))
        self.states.append(announcement.status.state)
        self.told.append(announcement)


class Shown:
    """A worker of which every sample is shown to `look` before the step over it."""

    def __init__(self, inner, look):
        self.__dict__.update(_inner=inner, _look=look)

    def __getattr__(self, name):
        return getattr(self._inner, name)

    def __setattr__(self, name, value):
        setattr(self._inner, name, value)

    def anew(self):
        return Shown(self._inner.anew(), self._look)

    def step(self, item):
        self._look(item)
        return self._inner.step(item)


def poison(failures, error=None):
    """Fails on chosen samples, a chosen number of times each, with `error` or one of its own."""

    def look(item):
        if failures.get(item.time, 0) > 0:
            failures[item.time] -= 1
            raise error or RuntimeError(f"cannot step over {item.time}")

    return look


@asynccontextmanager
async def plumbing(folder, announcer=None, checkpoint_every=1e9, store=None):
    """What a zone needs, with a store in `folder` unless there is another one."""
    metrics = Metrics({})
    sinks = [metrics] if announcer is None else [metrics, announcer]
    store, pool, asking = store or Store(folder), ThreadPoolExecutor(2), ThreadPoolExecutor(1)
    try:
        stopping = threading.Event()
        yield Plumbing("site", store, pool, Questions(asking, stopping), stopping, metrics, sinks, checkpoint_every)
    finally:
        asking.shutdown()
        pool.shutdown()
        store.close()


def make(shared, failures=None, name="z", error=None):
    return Zone(name, "rbpf", "mark", Shown(worker(), poison(failures or {}, error)), shared)


@asynccontextmanager
async def alone(folder, announcer=None):
    """A zone, and what it needs in `folder`."""
    async with plumbing(folder, announcer) as shared:
        yield make(shared), shared


async def fed(zone, items):
    await zone.prepare()
    running = asyncio.create_task(zone.run())
    await zone.intake.accept(items)
    return running


async def finished(zone, running):
    await zone.intake.close()
    await running


async def caught_up(zone, items):
    await until(lambda: (zone.now().status.last_sample_time, zone.now().status.state) == (items[-1].time, "running"))


async def through(zone, items):
    """Until the zone has run over `items`, and was ended."""
    running = await fed(zone, items)
    await caught_up(zone, items)
    await finished(zone, running)


def straight(items):
    alone = worker()
    return [comparable(alone.step(item)) for item in items]
