"""Backups of a state folder, made while the daemon runs, and put back while it does not.

A backup is one tar file: `manifest.json` with the size and SHA-256 of everything else, the journal as SQLite's online
backup gives it, the newest valid checkpoint of every zone, and the configuration that the daemon keeps in the folder.
The checkpoints are taken before the journal, so the journal has every sample after them, and the zones go on bit for
bit from the moment at which the journal was taken.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
import shutil
import sqlite3
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, NamedTuple

from adapters.fields.values import IDENTIFIER
from service.errors import BackupError
from service.store.checkpoint import CheckpointStore, Found
from service.store.durable_files import make_folder, sync_folder, write_file
from service.store.journal_file import SCHEMA_VERSION, schema_problem
from service.store.ownership import as_owner_of, database, open_plain
from service.store.store import CHECKPOINTS, CONFIGURATION, JOURNAL, RESTORING, locked

FORMAT_VERSION = 2
"""Since 2 the kept configuration is in a backup, where there is one."""
_MANIFEST = "manifest.json"
_NAMES = re.compile(rf"{re.escape(JOURNAL)}|{re.escape(CONFIGURATION)}|{CHECKPOINTS}/{IDENTIFIER}/\d+\.npz")
_UNPACKING = f"{RESTORING}.tmp"
_ATTEMPTS = 3
_BLOCK = 2**20
_PAGES = 1024
"""Of SQLite, copied between two notes of progress."""
_PASSES = 3
"""How often each byte of a backup is read: for the copy, its digest and the archive."""

Tick = Callable[[int, int], object]
"""Told how many more bytes are done, and how many there are in all."""

_log = logging.getLogger(__name__)


class _Watched:
    """A file that `tick` is told of as it is read."""

    def __init__(self, file: IO[bytes], tick: Callable[[int], object]) -> None:
        self._file, self._tick = file, tick

    def read(self, size: int = -1) -> bytes:
        """The next `size` bytes."""
        content = self._file.read(size)
        self._tick(len(content))
        return content


class Backup(NamedTuple):
    """A backup that was made or put back."""

    path: Path
    site: str
    made: datetime
    zones: int
    """How many zones have a checkpoint in it."""
    size: int
    """Bytes of what is in it."""


def write_backup(state_dir: Path, site: str, out: Path, tick: Tick = lambda more, total: None) -> Backup:
    """Write a backup of `state_dir` to the file `out`, or to a new file in the folder `out`; whole or not at all.

    `tick` is told of the progress. Raises BackupError where there is nothing to back up, `out` is there already, or
    cannot be written.
    """
    made = datetime.now(UTC).replace(microsecond=0)
    target = out / f"thermogate-{site}-{made:%Y%m%dT%H%M%SZ}.tar" if out.is_dir() else out
    if target is out and out.suffix != ".tar":
        raise BackupError(f"there is no folder {out}; make it, or name a new file that ends with .tar")
    if target.exists():
        raise BackupError(f"{target} exists already; name another file, or a folder to get a new one in it")
    if (state_dir / RESTORING).exists():
        raise BackupError(f"restoring a backup into {state_dir} was interrupted; run `thermogate restore` again")
    if not (state_dir / JOURNAL).exists():
        raise BackupError(f"there is no state in {state_dir}; correct site.state_dir, or run the daemon first")
    with _told(f"the backup {target} cannot be written"), _beside(target) as work:
        zones = _copy(state_dir, work / "state", tick)
        _copy_configuration(state_dir, work / "state")
        files = {str(path.relative_to(work / "state")): path for path in sorted((work / "state").rglob("*.*"))}
        size = sum(path.stat().st_size for path in files.values())
        tick(size - files[JOURNAL].stat().st_size, _PASSES * size)
        watched = partial(_watched, tick=lambda more: tick(more, _PASSES * size))
        described = {
            name: {"size": path.stat().st_size, "sha256": _sha256(path, watched)} for name, path in files.items()
        }
        manifest = {
            "format": FORMAT_VERSION,
            "site": site,
            "made": made.isoformat(),
            "thermogate": version("thermogate"),
            "files": described,
        }
        (work / _MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        with (work / "tar").open("wb") as file:
            os.fchmod(file.fileno(), 0o600)
            with tarfile.open(fileobj=file, mode="w") as archive:
                archive.add(work / _MANIFEST, _MANIFEST)
                for name, path in files.items():
                    with watched(path) as content:
                        archive.addfile(archive.gettarinfo(path, name), content)
            file.flush()
            os.fsync(file.fileno())
        (work / "tar").rename(target)
        sync_folder(target.parent)
    return Backup(target, site, made, zones, size)


def restore_backup(
    state_dir: Path, site: str, backup: Path, replace: bool, tick: Tick = lambda more, total: None
) -> tuple[Backup, Path | None]:
    """Put `backup` in the place of what is in `state_dir`, which is set aside in the folder that is returned.

    `tick` is told of the progress. The daemon must be stopped. Raises BackupError where the backup is damaged or of
    another site, and where there is state already unless `replace`; then nothing has changed.
    """
    told = f"the backup {backup} cannot be restored into {state_dir}"
    with locked(state_dir), _told(told), backup.open("rb") as file:
        with as_owner_of(state_dir) as folder:
            there = [name for name in os.listdir(folder) if name.startswith(JOURNAL) or name == CHECKPOINTS]
            interrupted = (folder / RESTORING).exists()
        if there and not replace and not interrupted:
            raise BackupError(f"there is state in {state_dir} already; say --replace to set it aside for the backup")
        try:
            with as_owner_of(state_dir) as folder:
                shutil.rmtree(folder / _UNPACKING, ignore_errors=True)
                restored = _unpack(file, backup, site, folder / _UNPACKING, tick)
            _check_journal(state_dir / _UNPACKING / JOURNAL, backup)
        except BaseException:
            with as_owner_of(state_dir) as folder:
                shutil.rmtree(folder / _UNPACKING, ignore_errors=True)
            raise
        with as_owner_of(state_dir) as folder:
            aside = _put_in_place(folder, there)
    return restored, None if aside is None else state_dir / aside


def _put_in_place(folder: Path, there: list[str]) -> Path | None:
    """Move what was unpacked into `folder`, and what is `there` into a folder beside it, which is returned."""
    unpacked = folder / _UNPACKING
    if (unpacked / CONFIGURATION).exists() and (folder / CONFIGURATION).exists():
        there = [*there, CONFIGURATION]
    # From here to the end of the moves no daemon starts on the half of it.
    make_folder(folder / RESTORING)
    aside = folder / f"before-restore-{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}" if there else None
    if aside is not None:
        make_folder(aside)
        for name in there:
            (folder / name).rename(aside / name)
        sync_folder(aside)
    for path in unpacked.iterdir():
        path.rename(folder / path.name)
    sync_folder(folder)
    unpacked.rmdir()
    (folder / RESTORING).rmdir()
    sync_folder(folder)
    return aside


def _copy(state_dir: Path, folder: Path, tick: Tick) -> int:
    """Copy checkpoints and journal into `folder`, such that they go together; how many zones have a checkpoint."""
    for _ in range(_ATTEMPTS):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        steps = _copy_checkpoints(state_dir, folder / CHECKPOINTS)
        with (
            database(state_dir / JOURNAL, "rw") as source,
            closing(sqlite3.connect(folder / JOURNAL)) as copy,
        ):
            _copy_journal(source, copy, tick)
            (verdict,) = copy.execute("PRAGMA quick_check(1)").fetchone()
            if verdict != "ok":
                raise BackupError(f"the journal {state_dir / JOURNAL} is damaged ({verdict}); restore an older backup")
            pruned: dict[str, int] = dict(copy.execute("SELECT zone, time FROM pruned"))
        if all(pruned.get(zone, step) <= step for zone, step in steps.items()):
            return len(steps)
    raise BackupError(f"the journal in {state_dir} is pruned faster than it can be copied; raise site.max_journal")


def _copy_journal(source: sqlite3.Connection, copy: sqlite3.Connection, tick: Tick) -> None:
    """All of `source` as it is now into `copy`."""
    (size,) = source.execute("PRAGMA page_size").fetchone()
    # While this reads, the copy is of one moment, and what the daemon commits does not make it begin anew.
    source.execute("BEGIN")
    (left,) = source.execute("PRAGMA page_count").fetchone()

    def note(status: int, remaining: int, total: int) -> None:
        nonlocal left
        tick(size * (left - remaining), _PASSES * size * total)
        left = remaining

    source.backup(copy, pages=_PAGES, progress=note, sleep=0.0)


def _copy_configuration(state_dir: Path, folder: Path) -> None:
    """Copy the configuration that the daemon keeps, unless it is from before it kept any."""
    with suppress(FileNotFoundError):
        with as_owner_of(state_dir) as state, open(open_plain(state / CONFIGURATION), "rb") as file:
            content = file.read()
        write_file(folder / CONFIGURATION, content)


def _version(connection: sqlite3.Connection) -> int:
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _copy_checkpoints(state_dir: Path, folder: Path) -> dict[str, int]:
    """Copy the newest sound checkpoint of every zone into `folder`; their steps."""
    steps = {}
    with as_owner_of(state_dir) as state:
        zones = CheckpointStore(state / CHECKPOINTS).zones()
    for zone in zones:
        with as_owner_of(state_dir) as state:
            newest = _newest_checkpoint(CheckpointStore(state / CHECKPOINTS), zone)
        if newest is not None:
            (folder / zone).mkdir(parents=True)
            (folder / zone / f"{newest.step:012d}.npz").write_bytes(newest.content)
            steps[zone] = newest.step
    return steps


def _newest_checkpoint(store: CheckpointStore, zone: str) -> Found | None:
    for found in store.found(zone):
        if found.checkpoint is not None:
            return found
        _log.warning("checkpoint %s is left out of the backup: %s", found.where, found.damage)
    return None


def _check_journal(path: Path, backup: Path) -> None:
    """BackupError where the journal at `path`, out of `backup`, is none that a daemon would open."""
    with database(path, "rw") as journal:
        schema = _version(journal)
        if schema > SCHEMA_VERSION:
            raise BackupError(f"the journal in {backup} has schema {schema} of a newer Thermogate; upgrade Thermogate")
        if (problem := schema_problem(journal)) is not None:
            raise BackupError(f"{backup} is damaged, or made to do damage: its journal {problem}; use another backup")


def unpacked_backup(backup: Path, folder: Path) -> Backup:
    """Everything in `backup` of any site, checked against its manifest, in the new `folder`. Raises BackupError."""
    with _told(f"the backup {backup} cannot be read"), backup.open("rb") as file:
        return _unpack(file, backup, None, folder, lambda more, total: None)


def _unpack(file: IO[bytes], backup: Path, site: str | None, folder: Path, tick: Tick) -> Backup:
    """Everything in the `file` of `backup` of `site` (None: any), checked against its manifest, durable in the new
    `folder`."""
    make_folder(folder)
    with tarfile.open(fileobj=file, mode="r:") as archive:
        manifest = _manifest(archive, backup)
        if site not in (None, manifest["site"]):
            raise BackupError(
                f"{backup} is a backup of the site '{manifest['site']}', and the configuration is that of '{site}'"
            )
        total = sum(described["size"] for described in manifest["files"].values())
        missing = dict(manifest["files"])
        # A backup is not compressed: what is in it cannot be larger than it is.
        if sum(described["size"] for described in missing.values()) > os.fstat(file.fileno()).st_size:
            raise BackupError(f"{backup} is damaged: it claims to hold more than there is; use another backup")
        for member in archive:
            if member.name == _MANIFEST:
                continue
            described = missing.pop(member.name, None)
            content = archive.extractfile(member) if _is_plain(member) else None
            if described is None or content is None or not _NAMES.fullmatch(member.name):
                raise BackupError(f"{backup} is damaged: '{member.name}' does not belong into it; use another backup")
            target = folder / member.name
            make_folder(target.parent)
            unpacked = _Watched(content, lambda more: tick(more, total))
            if member.size != described["size"] or _write(unpacked, target) != described["sha256"]:
                raise BackupError(f"{backup} is damaged: '{member.name}' does not match its digest; use another backup")
            sync_folder(target.parent)
        if missing:
            raise BackupError(f"{backup} is damaged: '{next(iter(missing))}' is missing; use another backup")
    files = manifest["files"]
    zones = {Path(name).parent for name in files if name.startswith(f"{CHECKPOINTS}/")}
    return Backup(
        backup,
        manifest["site"],
        datetime.fromisoformat(manifest["made"]),
        len(zones),
        sum(f["size"] for f in files.values()),
    )


def _is_plain(member: tarfile.TarInfo) -> bool:
    """Whether it is a file of its own: no link to another one, no device, and without holes."""
    return member.isreg() and not member.issparse()


def _manifest(archive: tarfile.TarFile, backup: Path) -> dict[str, Any]:
    try:
        member = archive.next()
        found = member is not None and member.name == _MANIFEST and _is_plain(member)
        content = archive.extractfile(member) if member is not None and found else None
        manifest = json.loads(content.read(2**24)) if content is not None else {}
        if manifest["format"] > FORMAT_VERSION:
            raise BackupError(f"{backup} was made by a newer Thermogate; upgrade Thermogate")
        complete = {"site", "made", "files"} <= manifest.keys() and JOURNAL in manifest["files"]
        sizes = [int(entry["size"]) for entry in manifest["files"].values() if isinstance(entry["sha256"], str)]
        datetime.fromisoformat(manifest["made"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise BackupError(f"{backup} is no backup of Thermogate, or damaged: it has no manifest") from error
    if not complete or min(sizes, default=-1) < 0 or len(sizes) < len(manifest["files"]):
        raise BackupError(f"{backup} is damaged: its manifest is not complete; use another backup")
    return dict(manifest)


def _write(content: _Watched, target: Path) -> str:
    """Write `content` to `target`, durably; its SHA-256."""
    digest = hashlib.sha256()
    # It tells when people are at home, and a configuration may hold passwords.
    with open(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        while block := content.read(_BLOCK):
            digest.update(block)
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
    return digest.hexdigest()


@contextmanager
def _watched(path: Path, tick: Callable[[int], object]) -> Iterator[_Watched]:
    with path.open("rb") as file:
        yield _Watched(file, tick)


def _sha256(path: Path, watched: Callable[[Path], AbstractContextManager[_Watched]]) -> str:
    digest = hashlib.sha256()
    with watched(path) as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


@contextmanager
def _beside(target: Path) -> Iterator[Path]:
    """A folder for work in progress on the disk of `target`, gone afterwards."""
    with tempfile.TemporaryDirectory(prefix=".thermogate-", dir=target.parent) as work:
        yield Path(work)


@contextmanager
def _told(what: str) -> Iterator[None]:
    """Turn what files, SQLite and tar raise into one sentence that begins with `what`."""
    try:
        yield
    except OSError as error:
        raise BackupError(
            f"{what} ({error.strerror or error}); check the path, its permissions and the space"
        ) from error
    except (sqlite3.Error, tarfile.TarError, EOFError) as error:
        raise BackupError(f"{what} ({error}); check the file and its disk") from error
