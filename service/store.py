"""The daemon's durable store: journal and checkpoints, each touched by one thread at a time.

Both do blocking disk work, so every call hops off the event loop: the journal to a thread of its own (SQLite wants
one), checkpoints to the caller's pool.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from service.checkpoint import CheckpointStore
from service.errors import ServiceError, StateMismatch
from service.journal import HistoryRow, Journal
from service.records import Sample, Update

_PAGE = 500

Result = TypeVar("Result")


class Store:
    """Journal and checkpoints under one `state_dir`, which no other daemon may use meanwhile."""

    def __init__(self, state_dir: Path) -> None:
        """Opens both and takes the lock. Raises ServiceError with the remedy where that fails."""
        self.path = state_dir
        self._lock: int | None = _lock(state_dir)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="journal")
        self._journal = Journal.open(state_dir / "journal.sqlite3")
        self.checkpoints = CheckpointStore(state_dir / "checkpoints")

    async def claim(self, zone: str, fingerprint: str) -> None:
        """Make sure that what the journal holds of `zone` belongs to `fingerprint`; StateMismatch otherwise."""
        if not await self._run(self._journal.claim, zone, fingerprint):
            raise StateMismatch(zone, self.path)

    async def append(self, zone: str, sample: Sample) -> bool:
        """Make an accepted sample durable; False if it already was."""
        return await self._run(self._journal.append, zone, sample)

    async def record(self, zone: str, update: Update) -> None:
        """Add an update to the history; durable with the next `append` or `flush`."""
        await self._run(self._journal.record, zone, update)

    async def flush(self) -> None:
        """Make the recorded history durable."""
        await self._run(self._journal.flush)

    async def skip(self, zone: str, time: int, reason: str) -> None:
        """Mark a sample that no attempt could assimilate."""
        await self._run(self._journal.skip, zone, time, reason)

    async def forget(self, zone: str) -> None:
        """Set all state of a zone aside."""
        await self._run(self._journal.forget, zone)
        self.checkpoints.reset(zone)

    async def last_sample_time(self, zone: str) -> int | None:
        """Time of the newest accepted sample of `zone`."""
        return await self._run(self._journal.last_sample_time, zone)

    async def samples_after(self, zone: str, time: int | None) -> list[Sample]:
        """The next accepted samples later than `time`, at most a page of them."""
        return await self._run(lambda: list(islice(self._journal.samples_after(zone, time), _PAGE)))

    async def history(self, zone: str, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """History rows, as `Journal.history`."""
        return await self._run(self._journal.history, zone, start, end, limit)

    def close(self) -> None:
        """Flush and close the journal and release the lock; safe to call twice."""
        self._thread.shutdown(wait=True)
        self._journal.close()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    async def _run(self, function: Callable[..., Result], *arguments: Any) -> Result:
        return await asyncio.get_running_loop().run_in_executor(self._thread, function, *arguments)


def _lock(state_dir: Path) -> int:
    """An exclusive lock on `state_dir`, held until its descriptor is closed or the process ends."""
    try:
        state_dir.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(state_dir / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise ServiceError(
            f"site.state_dir {state_dir} cannot be written ({error.strerror}); choose another"
        ) from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        raise ServiceError(
            f"another thermogate already runs on site.state_dir {state_dir}; stop it or use another state_dir"
        ) from error
    return descriptor
