"""The store of a daemon on one machine: a folder with the journal on SQLite and the checkpoints as files."""

import errno
import fcntl
import logging
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from service.errors import ServiceError
from service.records.measures import Measure, Rows, single
from service.store.checkpoint import CheckpointStore
from service.store.durable_files import SPACE, make_folder
from service.store.journal import Journal
from service.store.journal_file import JournalFile
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
            database = JournalFile.open(state_dir / JOURNAL)
            database.watch(state_dir / "lock", state_dir / JOURNAL)
        except BaseException:
            os.close(self._lock)
            raise
        super().__init__(Journal(database), CheckpointStore(state_dir / CHECKPOINTS), state_dir)

    def measures(self) -> list[Measure]:
        text = "Size of the journal with its write-ahead log"

        def read() -> Rows:
            return single(float(sum(path.stat().st_size for path in self.path.glob(f"{JOURNAL}*"))))

        return [Measure("thermogate_journal_bytes", "gauge", text, (), read)]

    def close(self) -> None:
        try:
            super().close()
        finally:
            if self._lock is not None:
                os.close(self._lock)
                self._lock = None


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
