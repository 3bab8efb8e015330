"""Everything that is stored looked through: whether journal, checkpoints and backups are whole."""

import tempfile
from pathlib import Path
from typing import NamedTuple

from service.errors import JournalError, ServiceError
from service.store.audit import broken_links
from service.store.backup import unpacked_backup
from service.store.checkpoint import CheckpointStore
from service.store.journal import ROWS, Journal, is_aside
from service.store.journal_file import JournalFile, schema_problem, translated
from service.store.ownership import database
from service.store.store import CHECKPOINTS, JOURNAL


class Verified(NamedTuple):
    """What was looked through, and what is wrong with it, a sentence each."""

    zones: int
    samples: int
    rows: int
    """Of the history."""
    checkpoints: int
    audited: int
    """Lines of the audit trail, of which a backup has none."""
    problems: tuple[str, ...]


def verify(path: Path, signed_by: Path | None = None) -> Verified:
    """Look through the state folder or the backup at `path`, which a daemon may use meanwhile. Raises ServiceError
    where there is neither, or a backup is not whole, or not `signed_by` the key whose public part is in that file."""
    if path.is_dir():
        if signed_by is not None:
            raise ServiceError(f"{path} is a state folder, which nobody signs; leave --signed-by out")
        return _verify_state(path)
    with tempfile.TemporaryDirectory(prefix=".thermogate-", dir=path.parent) as work:
        unpacked_backup(path, Path(work) / "state", signed_by)
        return _verify_state(Path(work) / "state")


def _verify_state(folder: Path) -> Verified:
    path = folder / JOURNAL
    if not path.exists():
        raise ServiceError(f"there is no state in {folder}; name the folder that site.state_dir names, or a backup")
    problems: list[str] = []
    samples = rows = 0
    with translated(path), database(path) as connection:
        strange = schema_problem(connection)
        # A view in the place of a table may have no end, nor need the look at a table whose rows are to be computed.
        # Only the whole check looks at the order of keys, by which rows are found.
        whole = "PRAGMA integrity_check(5)"
        checked = [f" {strange}"] if strange else [f": {row[0]}" for row in connection.execute(whole)]
        problems += [f"the journal {path}{damage}" for damage in checked if damage != ": ok"]
        journal = Journal(JournalFile(connection, path))
        # What was set aside is no longer a chain.
        listed = [] if strange else journal.read("SELECT zone FROM zones ORDER BY zone")
        zones = [zone for (zone,) in listed if not is_aside(zone)]
        for zone in zones:
            try:
                samples += sum(1 for _ in journal.samples_after(zone, None))
            except JournalError as error:
                problems.append(str(error))
            ((there,),) = journal.read("SELECT count(*) FROM history WHERE zone = ?", zone)
            sound = _sound_rows(journal, zone)
            rows += sound
            if sound < there:
                problems.append(f"the journal {path}: {there - sound} rows of the history of zone '{zone}' are damaged")
        for table in () if strange else ROWS:
            strays = f"FROM {table} WHERE instr(zone, '@') = 0 AND zone NOT IN (SELECT zone FROM zones)"  # noqa: S608
            ((stray,),) = journal.read(f"SELECT count(*) {strays}")
            if stray:
                problems.append(f"the journal {path}: {stray} rows of {table} are of zones that it does not know")
    checkpoints = 0
    store = CheckpointStore(folder / CHECKPOINTS)
    for zone in store.zones():
        for found in store.found(zone):
            checkpoints += 1
            if found.damage is not None:
                problems.append(f"the checkpoint {found.where} is damaged: {found.damage}")
    audited, strange_lines = broken_links(folder)
    return Verified(len(zones), samples, rows, checkpoints, audited, (*problems, *strange_lines))


def _sound_rows(journal: Journal, zone: str) -> int:
    """How many rows of the history of `zone` have their right checksum."""
    count = 0
    start: int | None = -(2**62)
    while start is not None:
        times, _, start = journal.history_columns(zone, start, 2**62, 1)
        count += len(times)
    return count
