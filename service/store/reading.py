"""A state folder read and left as it is, whether a daemon runs on it or not."""

import logging
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from service.errors import JournalError, ServiceError
from service.store.checkpoint import Checkpoint, Checkpoints, CheckpointStore
from service.store.database import other_version
from service.store.journal import Journal
from service.store.journal_file import SCHEMA_VERSION, JournalFile, schema_problem, translated
from service.store.store import CHECKPOINTS, JOURNAL

_log = logging.getLogger(__name__)


class StoredState(NamedTuple):
    """Journal and checkpoints of a site, wherever they are kept. Nothing is written, locked or set aside.

    No transaction is held between two reads: the daemon's write-ahead log would grow for as long.
    """

    journal: Journal
    checkpoints: Checkpoints

    def checkpoint(self, zone: str, fingerprint: str) -> Checkpoint | None:
        """The newest sound checkpoint of `zone` that belongs to `fingerprint`; None if there is none."""
        found = self.checkpoints.newest(zone)
        sound = None if found is None else found.checkpoint
        return sound if sound is not None and sound.fingerprint == fingerprint else None


@contextmanager
def read_state(state_dir: Path) -> Iterator[StoredState]:
    """The state in `state_dir`; ServiceError where there is none, of another version, or unreadable."""
    path = (state_dir / JOURNAL).absolute()
    if not path.exists():
        raise ServiceError(f"there is no state in {state_dir}; name the folder that site.state_dir names")
    with translated(path):
        connection = sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True, isolation_level=None)
    try:
        with translated(path):
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            if version != SCHEMA_VERSION:
                raise JournalError(other_version(f"the journal {path}", version, SCHEMA_VERSION, "state_dir"))
            # A view in the place of a table may have no end.
            if (problem := schema_problem(connection)) is not None:
                raise JournalError(f"the journal {path} {problem}; `thermogate verify {state_dir}` looks at all of it")
        yield StoredState(Journal(JournalFile(connection, path)), CheckpointStore(state_dir / CHECKPOINTS))
    finally:
        connection.close()


def stored_fingerprints(state_dir: Path) -> dict[str, str]:
    """The fingerprint of every zone with samples in `state_dir`, by its id; none where it cannot be read."""
    try:
        with read_state(state_dir) as state:
            return state.journal.fingerprints()
    # Who checks a configuration need not be one who may look into the state folder.
    except (OSError, ServiceError) as error:
        _log.debug("the zones of %s cannot be read: %s", state_dir, error)
        return {}
