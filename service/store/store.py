"""The store of a daemon on one machine: a folder with the journal on SQLite and the checkpoints as files."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from service.errors import JournalError, ServiceError
from service.records.measures import Measure, Rows, single
from service.store.checkpoint import CheckpointStore
from service.store.database import Result
from service.store.durable_files import SPACE, make_folder
from service.store.journal import Journal
from service.store.journalling import JournalStore
from service.store.ownership import as_owner_of, open_plain

JOURNAL = "journal.sqlite3"
CHECKPOINTS = "checkpoints"
CONFIGURATION = "configuration.toml"
"""What the daemon runs with, for those who read the folder."""
RESTORING = "restoring"
"""Folder in a state_dir into which a backup is unpacked; while it is there the rest is not to be trusted."""

_log = logging.getLogger(__name__)


class Store(JournalStore):
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
            journal = Journal.open(state_dir / JOURNAL)
        except BaseException:
            os.close(self._lock)
            raise
        super().__init__(journal, CheckpointStore(state_dir / CHECKPOINTS), state_dir)
        self._files = {name: _identity(state_dir / name) for name in ("lock", JOURNAL)}
        """What the files are that are open."""
        self._gone: str | None = None
        """Why nothing can be accepted, once the folder has been taken away."""

    def problems(self) -> list[str]:
        """What keeps the store from accepting anything until somebody helps; nothing if all is well."""
        return [] if self._gone is None else [self._gone]

    def _look(self) -> None:
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

    def measures(self) -> list[Measure]:
        """What metrics tell of the store."""
        text = "Size of the journal with its write-ahead log"

        def read() -> Rows:
            return single(float(sum(path.stat().st_size for path in self.path.glob(f"{JOURNAL}*"))))

        return [Measure("thermogate_journal_bytes", "gauge", text, (), read)]

    def close(self) -> None:
        """Flush and close the journal and release the lock; safe to call twice."""
        try:
            super().close()
        finally:
            if self._lock is not None:
                os.close(self._lock)
                self._lock = None

    async def write(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """As `run`; JournalError if the folder has been taken away."""
        return await self.run(self._in_place, function, *arguments)

    def _in_place(self, function: Callable[..., Result], *arguments: Any) -> Result:
        self._look()
        result = function(*arguments)
        self._look()
        return result


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
        with as_owner_of(state_dir) as folder:
            descriptor = open_plain(folder / "lock", os.O_RDWR | os.O_CREAT)
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
