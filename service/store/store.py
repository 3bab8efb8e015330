"""The daemon's durable store: journal and checkpoints, each touched by one thread at a time.

Both do blocking disk work, so every call hops off the event loop: the journal to a thread of its own (SQLite wants
one), checkpoints to the caller's pool.
"""

from __future__ import annotations

import asyncio
import errno
import fcntl
import logging
import os
import stat
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from itertools import islice
from math import inf
from pathlib import Path
from typing import Any, TypeVar

from adapters.reading import Reading
from service.errors import JournalError, ServiceError, StateMismatch
from service.fields.times import written_time
from service.records.history import HistoryRow
from service.records.measures import Measure, Rows, single
from service.records.sample import Sample
from service.records.series import Series
from service.records.update import Update
from service.store.checkpoint import Checkpoint, CheckpointStore
from service.store.durable_files import SPACE, make_folder
from service.store.journal import Journal
from service.store.retention import Limits, prune
from service.store.series import Buckets, Page, Stretch, history_page, inputs_page, joined, series_of

_PAGE = 500

PRUNE_SECONDS = 60.0
"""How often the journal is looked through for what its limits no longer allow."""

LOOK_SECONDS = 10.0
"""How often the store looks whether its folder is still there."""

_BETWEEN_SLICES = 0.02
"""Pause between two slices of pruning, in s: other work of the journal's thread comes first."""

JOURNAL = "journal.sqlite3"
CHECKPOINTS = "checkpoints"
CONFIGURATION = "configuration.toml"
"""What the daemon runs with, for those who read the folder."""
RESTORING = "restoring"
"""Folder in a state_dir into which a backup is unpacked; while it is there the rest is not to be trusted."""

_log = logging.getLogger(__name__)

_DONE = object()

Result = TypeVar("Result")


class Store:
    """Journal and checkpoints under one `state_dir`, which no other daemon may use meanwhile."""

    def __init__(self, state_dir: Path) -> None:
        """Opens both and takes the lock. Raises ServiceError with the remedy where that fails."""
        self.path = state_dir
        self._lock: int | None = lock(state_dir)
        _warn_of_onlookers(state_dir)
        try:
            if (state_dir / RESTORING).exists():
                raise ServiceError(
                    f"restoring a backup into {state_dir} was interrupted; run `thermogate restore` again"
                )
            self._journal = Journal.open(state_dir / JOURNAL)
        except BaseException:
            os.close(self._lock)
            raise
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="journal")
        self._files = {name: _identity(state_dir / name) for name in ("lock", JOURNAL)}
        """What the files are that are open."""
        self._gone: str | None = None
        """Why nothing can be accepted, once the folder has been taken away."""
        self.checkpoints = CheckpointStore(state_dir / CHECKPOINTS)
        self._recorded: deque[tuple[str, Update]] = deque()
        """Updates on their way to the journal's thread."""
        self._accepted: list[tuple[str, Sample]] = []
        """Samples that the next commit takes along."""
        self._commit: asyncio.Task[None] | None = None
        """That commit, while samples can still join it."""
        self._committing = asyncio.Lock()

    async def claim(self, zone: str, fingerprint: str) -> None:
        """Make sure that what the journal holds of `zone` belongs to `fingerprint`; StateMismatch otherwise."""
        if await self._run(self._journal.is_forgotten, zone):
            # The power failed while the zone was forgotten: the journal knows, the checkpoints do not yet.
            await self._forget_checkpoints(zone)
        if not await self._run(self._journal.claim, zone, fingerprint):
            raise StateMismatch(zone, self.path)

    async def append(self, zone: str, sample: Sample) -> None:
        """Make an accepted sample durable, unless it already is.

        Samples that come while another commit is under way share the next one: a thousand zones whose samples land
        at once need a few commits, not a thousand.
        """
        self._accepted.append((zone, sample))
        if self._commit is None:
            self._commit = asyncio.create_task(self._commit_accepted())
        # One zone that is stopped must not take the commit of the others with it.
        await asyncio.shield(self._commit)

    async def keep(self, zone: str, readings: Sequence[Reading]) -> None:
        """Make usable readings of an open interval durable, unless they already are."""
        await self._run(self._journal.keep, zone, readings)

    async def kept(self, zone: str, since: float, until: float = inf) -> list[Reading]:
        """The readings of `zone` that were kept, from `since` to `until` (UTC s), oldest first."""
        return await self._run(self._journal.kept, zone, since, until)

    def record(self, zone: str, update: Update) -> None:
        """Add an update to the history; durable with the next `append` or `flush`."""
        self._recorded.append((zone, update))

    async def ping(self) -> None:
        """Return once the thread of the journal has come to this."""
        await self._run(int)

    def problems(self) -> list[str]:
        """What keeps the store from accepting anything until somebody helps; nothing if all is well."""
        return [] if self._gone is None else [self._gone]

    async def watch(self) -> None:
        """Look for ever whether the folder is still there, and say so in the log if it is not."""
        while True:
            with suppress(ServiceError):
                await self._run(self._check_place)
            await asyncio.sleep(LOOK_SECONDS)

    async def flush(self) -> None:
        """Make the recorded history durable."""
        await self._write(self._journal.flush)

    async def skip(self, zone: str, time: int, reason: str) -> None:
        """Mark a sample that no attempt could assimilate."""
        await self._write(self._journal.skip, zone, time, reason)

    async def forget(self, zone: str) -> None:
        """Set all state of a zone aside."""
        await self._run(self._journal.forget, zone)
        await self._forget_checkpoints(zone)

    async def _forget_checkpoints(self, zone: str) -> None:
        await asyncio.to_thread(self.checkpoints.reset, zone)
        await self._run(self._journal.forgot, zone)

    async def resume_after(self, zone: str, checkpoint: int | None) -> int | None:
        """The time that telemetry of a restored `zone` goes on after; `checkpoint` is that of the one it was given.

        Says in the log where journal and checkpoint do not follow each other, which only a damaged disk brings about.
        """
        last = await self.last_sample_time(zone)
        pruned = await self._run(self._journal.pruned_until, zone)
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

    async def keep_within(self, limits: Limits) -> None:
        """Delete, for ever, what the journal holds beyond `limits`."""
        while True:
            try:
                slices = prune(self._journal, self.checkpoints.oldest, limits)
                while await self._run(next, slices, _DONE) is not _DONE:
                    await asyncio.sleep(_BETWEEN_SLICES)
                size = await self._run(self._journal.size)
                if size > limits.max_journal:
                    _log.warning(
                        "the journal takes %d bytes, more than max_journal = %d, and a start may need all of it; "
                        "raise max_journal, or see which zone writes no checkpoints",
                        size,
                        limits.max_journal,
                    )
            except ServiceError as error:
                _log.error("the journal cannot be kept within its limits: %s", error)
            await asyncio.sleep(PRUNE_SECONDS)

    def measures(self) -> list[Measure]:
        """What metrics tell of the store."""
        text = "Size of the journal with its write-ahead log"

        def read() -> Rows:
            return single(float(sum(path.stat().st_size for path in self.path.glob(f"{JOURNAL}*"))))

        return [Measure("thermogate_journal_bytes", "gauge", text, (), read)]

    async def samples_ahead(self, zone: str, after: int) -> int:
        """How many accepted samples of `zone` are later than `after`."""
        return await self._run(self._journal.samples_ahead, zone, after)

    async def set_back(self, zone: str, before: Checkpoint | None, then: Checkpoint | None, after: int) -> None:
        """Set aside what there is of `zone` later than `after`. `before` is its present state, `then` the one with
        which it goes on.

        A crash at any moment leaves `before`, which nothing follows in the journal, or the end: so the zone can be set
        back once more with the same result.
        """
        for checkpoint in (before, then):
            if checkpoint is not None:
                await asyncio.to_thread(self.checkpoints.save, zone, checkpoint, keep_all=True)
        await self._run(self._journal.set_aside, zone, after)
        await asyncio.to_thread(self.checkpoints.set_aside, zone, after)

    async def last_sample_time(self, zone: str) -> int | None:
        """Time of the newest accepted sample of `zone`."""
        return await self._run(self._journal.last_sample_time, zone)

    async def samples_after(self, zone: str, time: int | None) -> list[Sample]:
        """The next accepted samples later than `time`, at most a page of them."""
        return await self._run(lambda: list(islice(self._journal.samples_after(zone, time), _PAGE)))

    async def history(self, zone: str, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """History rows, as `Journal.history`."""
        return await self._run(self._journal.history, zone, start, end, limit)

    async def series(self, wanted: Stretch) -> Series:
        """The history and the inputs of a stretch, thinned out; other work of the journal comes in between."""
        history = await self._pages(history_page, wanted)
        return series_of(history, await self._pages(inputs_page, wanted), wanted.bucket)

    async def _pages(self, page: Page, wanted: Stretch) -> Buckets:
        """All pages of a stretch, joined."""
        found: list[Buckets] = []
        start: int | None = wanted.start
        while start is not None:
            buckets, start = await self._run(page, self._journal, wanted, start)
            found.append(buckets)
        return joined(found)

    def close(self) -> None:
        """Flush and close the journal and release the lock; safe to call twice."""
        self._thread.shutdown(wait=True)
        self._take_recorded()
        self._journal.close()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    async def _commit_accepted(self) -> None:
        async with self._committing:
            accepted, self._accepted, self._commit = self._accepted, [], None
            await self._write(self._journal.append_all, accepted)

    async def _write(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """As `_run`, for what must still be there afterwards: ServiceError if the folder has been taken away."""
        return await self._run(self._in_place, function, *arguments)

    def _in_place(self, function: Callable[..., Result], *arguments: Any) -> Result:
        self._check_place()
        result = function(*arguments)
        self._check_place()
        return result

    def _check_place(self) -> None:
        """JournalError if the files that are open are no longer those in the folder: what is written to them now is
        lost with the process."""
        lost = [name for name, identity in self._files.items() if _identity(self.path / name) != identity]
        if not lost:
            if self._gone is not None:
                _log.info("site.state_dir %s is back", self.path)
            self._gone = None
            return
        gone = (
            f"site.state_dir {self.path} has been deleted or replaced while the daemon runs ({' and '.join(lost)}); "
            "nothing is accepted, because it would be lost; put the folder back, or start the daemon again"
        )
        if self._gone is None:
            _log.error("%s", gone)
        self._gone = gone
        raise JournalError(gone)

    async def _run(self, function: Callable[..., Result], *arguments: Any) -> Result:
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._in_order, function, *arguments)

    def _in_order(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """In the journal's thread: `function` after everything that was recorded before it."""
        self._take_recorded()
        return function(*arguments)

    def _take_recorded(self) -> None:
        while self._recorded:
            self._journal.record(*self._recorded.popleft())


def _warn_of_onlookers(folder: Path) -> None:
    """Say so if accounts that are neither the daemon's nor of its group can look into `folder`."""
    mode = stat.S_IMODE(folder.stat().st_mode)
    if mode & stat.S_IRWXO:
        _log.warning(
            "every account of this machine can get into site.state_dir %s (mode %04o), and what is in it tells when "
            "people are there; say: chmod o= %s",
            folder,
            mode,
            folder,
        )


def _identity(path: Path) -> tuple[int, int] | None:
    """Which file `path` is; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


@contextmanager
def locked(state_dir: Path) -> Iterator[None]:
    """Keep every daemon off `state_dir`; ServiceError if one is there."""
    descriptor = lock(state_dir)
    try:
        yield
    finally:
        os.close(descriptor)


def lock(state_dir: Path) -> int:
    """An exclusive lock on `state_dir`, held until its descriptor is closed or the process ends."""
    try:
        make_folder(state_dir)
        descriptor = os.open(state_dir / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        with suppress(PermissionError):
            # Whoever can open it can hold the lock.
            os.fchmod(descriptor, 0o600)
    except OSError as error:
        remedy = SPACE if error.errno == errno.ENOSPC else "choose another"
        raise ServiceError(f"site.state_dir {state_dir} cannot be written ({error.strerror}); {remedy}") from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        raise ServiceError(
            f"another thermogate already runs on site.state_dir {state_dir}; stop it or use another state_dir"
        ) from error
    return descriptor
