"""What survives of a zone: its worker restored from the disk, saved to it, and set back with the clock.

A worker is restored from its newest checkpoint; what the journal holds beyond that is stepped over by the zone. The
journal keeps everything that is later than the oldest checkpoint, so that one which is damaged costs time and nothing
else.
"""

from __future__ import annotations

import asyncio
import logging
import time
import zlib
from collections.abc import Callable

from service.errors import ServiceError
from service.records.sample import Sample
from service.store.checkpoint import Checkpoint
from service.store.journalling import JournalStore
from service.zone import snapshot
from service.zone.clock import MOST_SET_ASIDE
from service.zone.intake import Intake
from service.zone.plumbing import Plumbing
from service.zone.worker import ZoneWorker

SET_BACK = "the clock of this machine was set back; waiting for the next sample"

_ENVIRONMENT = (OSError, MemoryError, ImportError, EOFError, ServiceError)
_OF_THE_COMPILER = ("numba", "llvmlite", "_pickle", "pickle")
"""Packages whose errors are those of the compiler and its cache."""

_log = logging.getLogger(__name__)


def is_of_the_environment(error: BaseException) -> bool:
    """Whether `error` is one of disk, memory, threads or compiler, for which no sample is to blame.

    So is one that has such a cause.
    """
    if isinstance(error, _ENVIRONMENT) or "can't start new thread" in str(error):
        return True
    if type(error).__module__.partition(".")[0] in _OF_THE_COMPILER:
        return True
    return error.__cause__ is not None and is_of_the_environment(error.__cause__)


class Recovery:
    """The state of `zone` on disk, which belongs to `fingerprint`; `estimator` is a name in the registry.

    `neighbours` makes the checkpoint that a zone begins with before its first sample. It blocks.
    """

    def __init__(
        self,
        zone: str,
        estimator: str,
        fingerprint: str,
        plumbing: Plumbing,
        neighbours: Callable[[], Checkpoint | None] = lambda: None,
    ) -> None:
        self._fingerprint = fingerprint
        self._zone, self._estimator, self._plumbing = zone, estimator, plumbing
        self._store, self._neighbours = plumbing.store, neighbours
        self._unsaved = False
        self._due = self._next()

    @property
    def patience(self) -> float | None:
        """In how many s the next checkpoint is due; None where there is nothing to save."""
        return self._due - time.monotonic() if self._unsaved else None

    async def restore(self, worker: ZoneWorker) -> int | None:
        """Put a fresh `worker` where the newest checkpoint was taken; the time of that one's sample, UTC s.

        Raises StateMismatch where the stored state belongs to another network.
        """
        await self._store.claim(self._zone, self._fingerprint)
        checkpoint = await self._in_pool(self._store.checkpoints.load, self._zone, self._fingerprint)
        if checkpoint is None:
            checkpoint = await first_checkpoint(self._store, self._zone, self._neighbours)
        if checkpoint is None:
            return None
        snapshot.restore(worker, checkpoint)
        return None if checkpoint.is_beginning else checkpoint.step

    async def beyond(self, worker: ZoneWorker) -> list[Sample]:
        """The next accepted samples that `worker` has not seen; none where it has seen all."""
        return await self._store.samples_after(self._zone, worker.progress.last_time)

    def went_on(self) -> None:
        """The worker has gone on since the last checkpoint."""
        self._unsaved = True

    async def save(self, worker: ZoneWorker) -> None:
        """Write a checkpoint of `worker`. Where that fails, the journal still holds everything since the last one."""
        checkpoint = self._checkpoint(worker)
        self._due = self._next()
        if checkpoint is None:
            return
        try:
            await self._store.run(self._store.journal.flush)
            await self._in_pool(self._store.checkpoints.save, self._zone, checkpoint)
            self._unsaved = False
            self._plumbing.metrics.checkpointed(self._zone, written=True)
        except ServiceError as error:
            self._plumbing.metrics.checkpointed(self._zone, written=False)
            _log.error("zone '%s': %s", self._zone, error)

    async def skip(self, when: int, reason: str) -> None:
        """Mark the sample at `when` as one that is not to be assimilated."""
        _log.error("zone '%s' passes over its sample at %d, which %s", self._zone, when, reason)
        try:
            await self._store.run(self._store.journal.skip, self._zone, when, reason)
        except ServiceError as failure:
            _log.error("zone '%s': %s", self._zone, failure)

    async def set_back(self, worker: ZoneWorker, intake: Intake) -> bool:
        """Go back to the present time, where the wall clock was set back by more than can be waited out; whether that
        was done.

        The samples that lie ahead of the clock were dated by one that was wrong. They have been learned from, and that
        is kept; but time must go on from now, and nothing in the journal may be overwritten. So they are set aside, and
        the zone goes on with a new segment. If they were more than MOST_SET_ASIDE, it is the clock that is wrong, and
        nothing is done. Nobody may use the worker meanwhile. Raises ServiceError, and then the zone has to be restored.
        """
        async with intake.accepting:
            now = intake.clock.wall()
            if intake.mailbox.waiting_since is not None or not intake.is_ahead(now):
                return False
            last = intake.aligned.last_before(now)
            ahead = await self._store.run(self._store.journal.samples_ahead, self._zone, last)
            if ahead * worker.period > MOST_SET_ASIDE:
                _log.error(
                    "zone '%s': %d samples lie ahead of the clock of this machine, too many to set aside; set the "
                    "clock, or give the zone's state up with --reset",
                    self._zone,
                    ahead,
                )
                return False
            before = self._checkpoint(worker)
            worker.set_back(last, SET_BACK)
            await self._store.set_back(self._zone, before, self._checkpoint(worker), last)
            intake.aligned.set_back(now)
        _log.warning(
            "zone '%s': the clock was set back; %d samples that lie ahead of it were set aside, and a new segment "
            "begins with the next sample",
            self._zone,
            ahead,
        )
        return True

    def _checkpoint(self, worker: ZoneWorker) -> Checkpoint | None:
        return snapshot.take(worker, self._fingerprint, self._estimator)

    async def _in_pool(self, function, *arguments):  # type: ignore[no-untyped-def]
        return await asyncio.get_running_loop().run_in_executor(self._plumbing.pool, function, *arguments)

    def _next(self) -> float:
        return next_moment(self._zone, self._plumbing.checkpoint_every, time.monotonic())


async def first_checkpoint(
    store: JournalStore, zone: str, neighbours: Callable[[], Checkpoint | None]
) -> Checkpoint | None:
    """The checkpoint that a `zone` without one begins with if it has no sample yet, on disk before the first one comes;
    None where it begins alone. Without it a crash could let it begin with something else."""
    if await store.run(store.journal.last_sample_time, zone) is not None:
        return None
    checkpoint = await asyncio.to_thread(neighbours)
    if checkpoint is not None:
        await asyncio.to_thread(store.checkpoints.save, zone, checkpoint)
        _log.info("zone '%s' begins with what its neighbours have learned", zone)
    return checkpoint


def next_moment(zone: str, every: float, now: float) -> float:
    """When the next checkpoint of `zone` is due, s on the clock of `now`, where one is written in `every` s: each zone
    has a moment of its own in that time, so that no instant sees those of all zones."""
    moment = zlib.crc32(zone.encode()) / 2**32 * every
    return now + ((moment - now) % every or every)
