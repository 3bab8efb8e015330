"""`thermogate learn`: recorded history into the state of a daemon's zones, as if the daemon had been running. A sample
is in the journal before a worker takes it, its update becomes a row of the history, and checkpoints follow: a run that
was interrupted goes on, and a second one finds nothing new. Zones learn on all cores, each in one process."""

import asyncio
import multiprocessing
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import asynccontextmanager
from typing import Any, NamedTuple

from estimator.arrays import DAY
from replay.processes import importing_once
from replay.recorded.trace import Trace, Tracer
from service.config.fitting import fingerprint, make_worker, neighbourhood
from service.config.kept import keep_configuration
from service.config.site import Config, ZoneConfig
from service.daemon.kernel_cache import guard_kernel_cache
from service.daemon.logs import audited
from service.errors import ServiceError
from service.recordings.history import History
from service.recordings.progress import Kernels, Progress
from service.records.sample import Sample
from service.records.update import Update
from service.store.audit import AUDIT, about
from service.store.checkpoint import Checkpoint
from service.store.store import Store
from service.zone import snapshot
from service.zone.recovery import first_checkpoint
from service.zone.worker import ZoneWorker

_CHUNK = 500
"""Samples that a zone takes between two checkpoints."""

WHOLE = 56 * DAY
"""s at the end of a history of which every sample is learned from."""

ONE_OF = 3
"""How many weeks there are, before WHOLE, to each one that is learned from. What a zone knows comes for the most part
from the last months; older weeks tell of other seasons, of which some days say most."""

_WEEK = 7 * DAY

_FIRST = 100
"""Samples after which a process has compiled or read nearly all kernels: what later ones take can be foreseen."""

_ENDED = (
    "a process that learned ended by itself, perhaps for want of memory; run the command again with --jobs 1: it goes "
    "on where it stopped"
)


class Learned(NamedTuple):
    traces: list[Trace]
    known: Mapping[str, int]
    """Samples of each zone that its state had already, and that were passed over."""


def learn(
    config: Config,
    histories: Mapping[str, History],
    *,
    jobs: int | None = None,
    plant: Config | None = None,
    reset: Sequence[str] = (),
) -> Learned:
    """Take the `histories` that `survey` has found for the zones of `config` into their state, in `jobs` processes
    (default: one for each core), and set the state of the zones `reset` aside first. Zones of `plant`, the daemon's own
    configuration (default: `config`), teach new ones. ServiceError where the state cannot be written, a daemon runs on
    it, or it belongs to another configuration."""
    store = Store(config.site.state_dir)
    plant = plant or config
    try:
        with audited(config.site.state_dir):
            keep_configuration(plant)
            return asyncio.run(_learned(store, config, plant, histories, jobs or os.cpu_count() or 1, reset))
    except BrokenProcessPool as error:
        raise ServiceError(_ENDED) from error
    except ExceptionGroup as group:
        # The first failure of a zone has ended the others.
        first = group.exceptions[0]
        raise (ServiceError(_ENDED) if isinstance(first, BrokenProcessPool) else first) from None
    finally:
        store.close()


async def _learned(
    store: Store, config: Config, plant: Config, histories: Mapping[str, History], jobs: int, reset: Sequence[str]
) -> Learned:
    """Let every zone learn from what is new, zones in turn in so many processes."""
    for name in reset:
        await store.forget(name)
        AUDIT.warning("the state of zone '%s' is set aside", name, extra=about("reset", "learn"))
    zones = [zone for zone in config.zones if histories[zone.id].recorded.samples]
    taken = {zone.id: chosen(histories[zone.id].recorded.samples) for zone in zones}
    jobs = max(1, min(jobs, len(zones)))
    async with _processes(jobs) as processes:
        owners = {zone.id: processes[place % jobs] for place, zone in enumerate(zones)}
        new: dict[_Student, Sequence[Sample]] = {}
        known: dict[str, int] = {}
        for zone in zones:
            samples = taken[zone.id]
            neighbours = neighbourhood(plant, zone, store.checkpoints)
            student = _Student(store, zone, owners[zone.id], neighbours, end=samples[-1].time)
            # All know where they begin before one of them goes on: no zone learns from what is new.
            last = await student.resume()
            new[student] = [sample for sample in samples if last is None or sample.time > last]
            if passed := len(samples) - len(new[student]):
                known[zone.id] = passed
        async with asyncio.TaskGroup() as tasks:
            for student in [*new][:jobs]:
                tasks.create_task(student.learn(new[student][:_FIRST]))
                new[student] = new[student][_FIRST:]
        total = sum(map(len, taken.values()))
        with Progress("learning", total, None, done=total - sum(map(len, new.values()))) as bar:
            if any(new.values()):
                bar.refresh()
            async with asyncio.TaskGroup() as tasks:
                for student, rest in new.items():
                    tasks.create_task(student.learn(rest, bar.update))
        loop = asyncio.get_running_loop()
        traces = [
            await loop.run_in_executor(owner, _trace, zone, histories[zone].recorded.refused)
            for zone, owner in owners.items()
        ]
    return Learned([trace for trace in traces if trace is not None], known)


def chosen(samples: Sequence[Sample]) -> list[Sample]:
    """Of the `samples` of a history those that are learned from: all of the last weeks, and of the time before some."""
    begin = samples[-1].time - WHOLE
    return [sample for sample in samples if sample.time >= begin or sample.time // _WEEK % ONE_OF == 0]


class _Student:
    """A zone that learns in the process `owner` from a history up to `end` [UTC s]; what it learns is written to
    `store`, and what a new one begins with comes from its `neighbours`."""

    def __init__(
        self,
        store: Store,
        zone: ZoneConfig,
        owner: ProcessPoolExecutor,
        neighbours: Callable[[], Checkpoint | None],
        end: int,
    ) -> None:
        self._store, self._zone, self._owner, self._neighbours = store, zone, owner, neighbours
        self._end = end
        self._fingerprint = fingerprint(zone)

    async def resume(self) -> int | None:
        """Put the zone where its state stands; the time [UTC s] of the last sample that it has, None if it has none."""
        name = self._zone.id
        await self._store.claim(name, self._fingerprint)
        checkpoint = await asyncio.to_thread(self._store.checkpoints.load, name, self._fingerprint)
        if checkpoint is None:
            checkpoint = await first_checkpoint(self._store, name, self._neighbours)
        await self._there(_begin, self._zone, self._fingerprint, checkpoint, self._end)
        step = None if checkpoint is None or checkpoint.is_beginning else checkpoint.step
        last = await self._store.resume_after(name, step)
        while samples := await self._store.samples_after(name, step):
            await self._learned(samples)
            step = samples[-1].time
        return last

    async def learn(self, new: Sequence[Sample], note: Callable[[int], object] = lambda count: None) -> None:
        """Take `new` in chunks and `note` their sizes; a sample is in the journal before it is learned from."""
        for begin in range(0, len(new), _CHUNK):
            samples = new[begin : begin + _CHUNK]
            await asyncio.gather(*(self._store.append(self._zone.id, sample) for sample in samples))
            await self._learned(samples)
            note(len(samples))

    async def _learned(self, samples: Sequence[Sample]) -> None:
        updates, checkpoint = await self._there(_take, self._zone.id, samples)
        for update in updates:
            self._store.record(self._zone.id, update)
        await self._store.run(self._store.journal.flush)
        if checkpoint is not None:
            await asyncio.to_thread(self._store.checkpoints.save, self._zone.id, checkpoint)

    async def _there(self, function: Any, *arguments: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._owner, function, *arguments)


@asynccontextmanager
async def _processes(count: int) -> AsyncIterator[list[ProcessPoolExecutor]]:
    """Pools of one process each, so that a zone stays in the process that knows it."""
    context = importing_once(__name__)
    shown = sys.stderr.isatty()
    pools = [ProcessPoolExecutor(1, context, _begun, (shown and not place,)) for place in range(count)]
    try:
        yield pools
    except BaseException:
        # Nobody waits for minutes of work that are not wanted any more; what was learned is on disk.
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        for pool in pools:
            pool.shutdown(wait=True, cancel_futures=True)


_students: dict[str, tuple[ZoneWorker, Tracer, ZoneConfig, str]] = {}
"""In a process that learns: its zones."""


def _begun(announces: bool) -> None:
    """In a new process: the parent alone answers Ctrl-C, and one process `announces` that it compiles."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    guard_kernel_cache()
    if announces:
        Kernels()


def _begin(zone: ZoneConfig, mark: str, checkpoint: Checkpoint | None, end: int) -> None:
    worker = make_worker(zone)
    worker.loop.history_end = end
    if checkpoint is not None:
        snapshot.restore(worker, checkpoint)
    _students[zone.id] = worker, Tracer(zone, worker), zone, mark


def _take(name: str, samples: Iterable[Sample]) -> tuple[list[Update], Checkpoint | None]:
    worker, tracer, zone, mark = _students[name]
    updates = []
    for sample in samples:
        if (update := worker.step(sample)) is not None:
            # Before the next step: it reads what the worker carries.
            tracer.note(update)
            updates.append(update)
    return updates, snapshot.take(worker, mark, zone.estimator)


def _trace(name: str, refused: Mapping[str, int]) -> Trace | None:
    """What a zone went through in this run, with the readings that were `refused`; None where it learned nothing."""
    tracer = _students[name][1]
    return tracer.trace(refused) if tracer.rows else None
