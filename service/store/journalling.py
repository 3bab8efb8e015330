"""A store over a journal and checkpoints: what is the same for SQLite and PostgreSQL.

Both do blocking work, so every call hops off the event loop: the journal to a thread of its own, checkpoints to the
caller's pool.
"""

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import islice
from typing import Any

from adapters.fields.times import written_time
from adapters.reading import Reading
from service.errors import CheckpointError, Fenced, ServiceError, StateMismatch
from service.records.measures import Measure
from service.records.sample import Sample
from service.records.series import Series, Stretch
from service.records.update import Update
from service.store.checkpoint import Checkpoint, Checkpoints
from service.store.database import Result
from service.store.journal import PAGE, Journal
from service.store.retention import FOREVER, Limits, Stable, prune
from service.store.series import Buckets, history_page, inputs_page, joined, series_of

_BETWEEN_SLICES = 0.02
"""Pause between two slices of pruning, in s: other work of the journal's thread comes first."""
_DONE = object()

_log = logging.getLogger(__name__)


class JournalStore(ABC):
    """`journal`, asked with `run`, and `checkpoints` behind the event loop; `place` says in messages where they are.
    Every method may raise ServiceError with the place and the remedy."""

    prune_seconds = 60.0
    """How often the journal is looked through for what its limits no longer allow."""

    look_seconds = 10.0
    """How often the store looks whether it can accept anything."""

    _too_large = "a start may need all of it; raise max_journal, or see which zone writes no checkpoints"
    """What is said of a journal that cannot be kept within `max_journal`."""

    def __init__(self, journal: Journal, checkpoints: Checkpoints, place: object) -> None:
        self.journal = journal
        self.checkpoints = checkpoints
        self._place = place
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="journal")
        self._accepted: list[tuple[str, Sample]] = []
        """Samples that the next commit takes along."""
        self._readings: list[tuple[str, Sequence[Reading]]] = []
        """Readings that it takes along."""
        self._commit: asyncio.Task[Mapping[str, Fenced]] | None = None
        """That commit, while more can still join it."""
        self._committing = asyncio.Lock()
        self.clock_is_stable: Callable[[], bool] = Stable()
        """Whether times tell what is old."""
        self.known_size = 0
        """Bytes that the journal took when it was last looked through."""

    async def claim(self, zone: str, fingerprint: str) -> None:
        """Make sure that what the journal holds of `zone` belongs to `fingerprint`; StateMismatch otherwise."""
        if await self.run(self.journal.is_forgotten, zone):
            # The power failed while the zone was forgotten, or an operator has marked it in the database.
            await self.forget(zone)
        if not await self.run(self.journal.claim, zone, fingerprint):
            raise StateMismatch(zone, self._place, self.journal.database.reset)

    async def append(self, zone: str, sample: Sample) -> None:
        """Make an accepted sample durable, unless it already is. Samples that come while another commit is under way
        share the next one: a thousand zones need a few commits."""
        self._accepted.append((zone, sample))
        await self._committed(zone)

    async def keep(self, zone: str, readings: Sequence[Reading]) -> None:
        """Make readings of an interval that is open durable, in a commit that they share likewise."""
        self._readings.append((zone, readings))
        await self._committed(zone)

    async def _committed(self, zone: str) -> None:
        if self._commit is None:
            self._commit = asyncio.create_task(self._commit_accepted())
        # One zone that is stopped must not take the commit of the others with it.
        refused = await asyncio.shield(self._commit)
        if zone in refused:
            raise refused[zone]

    def record(self, zone: str, update: Update) -> None:
        """Add an update to the history; durable with the next `append` or `flush`."""
        self.journal.record(zone, update)

    async def forget(self, zone: str) -> None:
        """Set all state of a zone aside."""
        await self.run(self.journal.forget, zone)
        await asyncio.to_thread(self.checkpoints.set_aside, zone)
        await self.run(self.journal.forgot, zone)

    async def resume_after(self, zone: str, checkpoint: int | None) -> int | None:
        """The time that telemetry of a restored `zone` goes on after; `checkpoint` is that of the one it was given. The
        log tells where journal and checkpoint do not follow each other, as on a damaged disk."""
        last = await self.run(self.journal.last_sample_time, zone)
        pruned = await self.run(self.journal.pruned_until, zone)
        if checkpoint is not None and (last is None or last < checkpoint):
            _log.warning(
                "zone '%s' goes on from its checkpoint at %s, but the journal ends %s: samples and history are missing",
                zone,
                written_time(checkpoint),
                "before any sample of it" if last is None else f"at {written_time(last)}",
            )
            return checkpoint
        if pruned is not None and (checkpoint is None or checkpoint < pruned):
            _log.warning(
                "zone '%s' has no readable checkpoint after %s, up to which its samples were deleted by "
                "keep_history or max_journal; it has learned anew from the later ones",
                zone,
                written_time(pruned),
            )
        return last

    async def set_back(self, zone: str, before: Checkpoint | None, then: Checkpoint | None, after: int) -> None:
        """Set aside what there is of `zone` later than `after`. `before` is its present state, `then` the one with
        which it goes on. A crash at any moment leaves `before`, which nothing follows in the journal, or the end: so
        the zone can be set back once more with the same result."""
        for checkpoint in (before, then):
            if checkpoint is not None:
                await asyncio.to_thread(self.checkpoints.save, zone, checkpoint, keep_all=True)
        await self.run(self.journal.set_aside, zone, after)
        await asyncio.to_thread(self.checkpoints.set_aside, zone, after)

    async def samples_after(self, zone: str, time: int | None) -> list[Sample]:
        """The next accepted samples later than `time`, at most a page of them."""
        return await self.run(lambda: list(islice(self.journal.samples_after(zone, time), PAGE)))

    async def series(self, wanted: Stretch) -> Series:
        """The history and the inputs of a stretch, thinned out; other work of the journal comes in between."""
        history, inputs = list[Buckets](), list[Buckets]()
        for page, found in ((history_page, history), (inputs_page, inputs)):
            start: int | None = wanted.start
            while start is not None:
                buckets, start = await self.run(page, self.journal, wanted, start)
                found.append(buckets)
        return series_of(joined(history), joined(inputs), wanted.bucket)

    def problems(self) -> list[str]:
        """What keeps the store from accepting anything until somebody helps; nothing if all is well."""
        trouble = self.journal.database.trouble
        return [] if trouble is None else [trouble]

    @abstractmethod
    def measures(self) -> list[Measure]:
        """What metrics tell of the store."""

    def _oldest_checkpoint(self, zone: str) -> int | None:
        """As `oldest` of the checkpoints; None, with which every sample stays, also where they cannot be listed."""
        try:
            return self.checkpoints.oldest(zone)
        except CheckpointError as error:
            _log.error("every sample of zone '%s' stays in the journal: %s", zone, error)
            return None

    async def watch(self) -> None:
        """Look for ever whether the store can accept anything, and say so in the log when it cannot."""
        while True:
            with suppress(ServiceError):
                await self.run(self.journal.flush)
            await asyncio.sleep(self.look_seconds)

    async def keep_within(self, limits: Limits) -> None:
        """Delete, for ever, what the journal holds beyond `limits`."""
        while True:
            try:
                aged = limits if self.clock_is_stable() else limits._replace(keep_history=FOREVER)
                slices = prune(self.journal, self._oldest_checkpoint, aged)
                while await self.run(next, slices, _DONE) is not _DONE:
                    await asyncio.sleep(_BETWEEN_SLICES)
                self.known_size = await self.run(self.journal.database.size)
                if self.known_size > limits.max_journal:
                    _log.warning(
                        "the journal takes %d bytes, more than max_journal = %d; %s",
                        self.known_size,
                        limits.max_journal,
                        self._too_large,
                    )
            except ServiceError as error:
                _log.error("the journal cannot be kept within its limits: %s", error)
            await asyncio.sleep(self.prune_seconds)

    def close(self) -> None:
        """Make durable what was recorded, and close everything; safe to call twice."""
        self._thread.shutdown(wait=True)
        try:
            self.journal.close()
        finally:
            self.checkpoints.close()

    async def _commit_accepted(self) -> Mapping[str, Fenced]:
        """Commit what was accepted; why that of some zones was not, by zone."""
        async with self._committing:
            accepted, kept = self._accepted, self._readings
            self._accepted, self._readings, self._commit = [], [], None
            try:
                await self.run(self.journal.append_all, accepted, kept)
            except Fenced as error:
                # A zone that has gone to another owner must not take what the others bring with it.
                rest, left = ([one for one in each if one[0] not in error.zones] for each in (accepted, kept))
                if not (rest or left) or len(rest) + len(left) == len(accepted) + len(kept):
                    raise
                await self.run(self.journal.append_all, rest, left)
                return dict.fromkeys(error.zones, error)
            return {}

    async def run(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """What `function` returns in the thread of the journal."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, function, *arguments)
