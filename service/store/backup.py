"""Backups of a state folder, made while the daemon runs, and put back while it does not.

A backup is one tar file: `manifest.json` with the size and SHA-256 of everything else, the journal as SQLite's online
backup gives it, the newest valid checkpoint of every zone, and the configuration that the daemon keeps in the folder.
The checkpoints are taken before the journal, so the journal has every sample after them, and the zones go on bit for
bit from the moment at which the journal was taken.
"""

import hashlib
import os
import re
import shutil
import sqlite3
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import IO, NamedTuple

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from pydantic import BaseModel, NonNegativeInt, ValidationError
from pydantic_core import from_json

from adapters.fields.values import IDENTIFIER
from service.errors import BackupError
from service.store.checkpoint import CheckpointStore
from service.store.database import other_version
from service.store.durable_files import make_folder, sync_folder, write_file
from service.store.journal_file import SCHEMA_VERSION, schema_problem
from service.store.ownership import as_owner_of, database, open_plain
from service.store.signing import is_signed, public_key, signature
from service.store.store import CHECKPOINTS, CONFIGURATION, JOURNAL, RESTORING, locked

FORMAT_VERSION = 2
"""Since 2 the kept configuration is in a backup, where there is one."""
_MANIFEST = "manifest.json"
_LARGEST_MANIFEST = 2**24
_NAMES = re.compile(rf"{re.escape(JOURNAL)}|{re.escape(CONFIGURATION)}|{CHECKPOINTS}/{IDENTIFIER}/\d+\.npz")
_UNPACKING = f"{RESTORING}.tmp"
_ATTEMPTS = 3
_BLOCK = 2**20


class _Content(BaseModel):
    size: NonNegativeInt
    sha256: str


class _Manifest(BaseModel):
    """What is in a backup."""

    format: int
    site: str
    made: datetime
    thermogate: str = ""
    files: dict[str, _Content]
    signature: str | None = None
    """Of `statement`, Ed25519 and base64; None: nobody signed."""

    @property
    def statement(self) -> bytes:
        """What is signed: the site, the time, and size and digest of every file."""
        head = ["thermogate backup", self.site, f"{self.made:%Y-%m-%dT%H:%M:%SZ}"]
        return "\n".join([*head, *(f"{each.sha256} {each.size} {name}" for name, each in self.files.items())]).encode()

    @property
    def size(self) -> int:
        return sum(file.size for file in self.files.values())


class Backup(NamedTuple):
    """A backup that was made or put back."""

    path: Path
    site: str
    made: datetime
    zones: int
    """How many zones have a checkpoint in it."""
    size: int
    """Bytes of what is in it."""
    signed: bool = False
    """Whether the key that was asked for has signed it."""


def write_backup(state_dir: Path, site: str, out: Path, sign_with: Path | None = None) -> Backup:
    """Write a backup of `state_dir` to the file `out`, or to a new file in the folder `out`, whole or not at all,
    signed with the private key in the file `sign_with`, if there is one. Raises BackupError where there is nothing to
    back up, `out` is there already, or cannot be written."""
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
    with (
        _told(f"the backup {target} cannot be written"),
        # On the disk of the target, and gone afterwards.
        tempfile.TemporaryDirectory(prefix=".thermogate-", dir=target.parent) as name,
    ):
        work = Path(name)
        zones = _copy(state_dir, work / "state")
        _copy_configuration(state_dir, work / "state")
        files = {str(path.relative_to(work / "state")): path for path in sorted((work / "state").rglob("*.*"))}
        manifest = _Manifest(
            format=FORMAT_VERSION,
            site=site,
            made=made,
            thermogate=version("thermogate"),
            files={name: _described(path) for name, path in files.items()},
        )
        if sign_with is not None:
            manifest.signature = signature(manifest.statement, sign_with)
        (work / _MANIFEST).write_text(manifest.model_dump_json(indent=2) + "\n", encoding="utf-8")
        with (work / "tar").open("wb") as file:
            os.fchmod(file.fileno(), 0o600)
            with tarfile.open(fileobj=file, mode="w") as archive:
                for name, path in {_MANIFEST: work / _MANIFEST, **files}.items():
                    archive.add(path, name)
            file.flush()
            os.fsync(file.fileno())
        (work / "tar").rename(target)
        sync_folder(target.parent)
    return Backup(target, site, made, zones, manifest.size, sign_with is not None)


def restore_backup(
    state_dir: Path, site: str, backup: Path, replace: bool, signed_by: Path | None = None
) -> tuple[Backup, Path | None]:
    """Put `backup` in the place of what is in `state_dir`, which is set aside in the folder that is returned. Raises
    BackupError where a daemon runs, the backup is damaged, of another site, or not `signed_by` the key whose public
    part is in that file, and where there is state already unless `replace`; then nothing has changed."""
    told = f"the backup {backup} cannot be restored into {state_dir}"
    # With the rights of the folder's owner, to whom the key need not be readable, it would be too late.
    public = None if signed_by is None else public_key(signed_by)
    with locked(state_dir), _told(told), backup.open("rb") as file:
        with as_owner_of(state_dir) as folder:
            there = [name for name in os.listdir(folder) if name.startswith(JOURNAL) or name == CHECKPOINTS]
            interrupted = (folder / RESTORING).exists()
        if there and not replace and not interrupted:
            raise BackupError(f"there is state in {state_dir} already; say --replace to set it aside for the backup")
        try:
            with as_owner_of(state_dir) as folder:
                shutil.rmtree(folder / _UNPACKING, ignore_errors=True)
                restored = _unpack(file, backup, site, folder / _UNPACKING, public)
            with database(state_dir / _UNPACKING / JOURNAL, alone=True) as journal:
                _check_journal(journal, f"the journal in {backup}", "backup")
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


def _copy(state_dir: Path, folder: Path) -> int:
    """Copy checkpoints and journal into `folder`, such that they go together; how many zones have a checkpoint."""
    for _ in range(_ATTEMPTS):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        steps = _copy_checkpoints(state_dir, folder / CHECKPOINTS)
        with database(state_dir / JOURNAL) as source, closing(sqlite3.connect(folder / JOURNAL)) as copy:
            # While this reads, the copy is of one moment, and what the daemon commits does not make it begin anew.
            source.execute("BEGIN")
            source.backup(copy)
            # Only then is it read: a view in the place of a table may have no end.
            _check_journal(copy, f"the journal {state_dir / JOURNAL}", "state_dir")
            (verdict,) = copy.execute("PRAGMA integrity_check(1)").fetchone()
            if verdict != "ok":
                raise BackupError(f"the journal {state_dir / JOURNAL} is damaged ({verdict}); restore an older backup")
            pruned: dict[str, int] = dict(copy.execute("SELECT zone, time FROM pruned"))
        if all(pruned.get(zone, step) <= step for zone, step in steps.items()):
            return len(steps)
    raise BackupError(f"the journal in {state_dir} is pruned faster than it can be copied; raise site.max_journal")


def _copy_configuration(state_dir: Path, folder: Path) -> None:
    """Copy the configuration that the daemon keeps, unless it is from before it kept any."""
    with suppress(FileNotFoundError):
        with as_owner_of(state_dir) as state, open(open_plain(state / CONFIGURATION), "rb") as file:
            content = file.read()
        write_file(folder / CONFIGURATION, content)


def _copy_checkpoints(state_dir: Path, folder: Path) -> dict[str, int]:
    """Copy the newest sound checkpoint of every zone into `folder`; their steps."""
    steps = {}
    with as_owner_of(state_dir) as state:
        zones = CheckpointStore(state / CHECKPOINTS).zones()
    for zone in zones:
        with as_owner_of(state_dir) as state:
            newest = CheckpointStore(state / CHECKPOINTS).newest(zone)
        if newest is not None:
            (folder / zone).mkdir(parents=True)
            (folder / zone / f"{newest.step:012d}.npz").write_bytes(newest.content)
            steps[zone] = newest.step
    return steps


def _check_journal(journal: sqlite3.Connection, place: str, elsewhere: str) -> None:
    """BackupError where the `journal` at a `place` is none that a daemon would open."""
    (schema,) = journal.execute("PRAGMA user_version").fetchone()
    if schema != SCHEMA_VERSION:
        raise BackupError(other_version(place, schema, SCHEMA_VERSION, elsewhere))
    if (problem := schema_problem(journal)) is not None:
        raise BackupError(f"{place} is damaged, or made to do damage: it {problem}; use another {elsewhere}")


def unpacked_backup(backup: Path, folder: Path, signed_by: Path | None = None) -> Backup:
    """Everything in `backup` of any site, checked against its manifest, and that against the public key in the file
    `signed_by`, in the new `folder`. Raises BackupError."""
    public = None if signed_by is None else public_key(signed_by)
    with _told(f"the backup {backup} cannot be read"), backup.open("rb") as file:
        return _unpack(file, backup, None, folder, public)


def _unpack(
    file: IO[bytes], backup: Path, site: str | None, folder: Path, signer: Ed25519PublicKey | None = None
) -> Backup:
    """Everything in the `file` of `backup` of `site` (None: any), checked against its manifest, and that against the
    key of its `signer` (None: anybody), durable in the new `folder`."""

    def damaged(what: str) -> BackupError:
        return BackupError(f"{backup} is damaged: {what}; use another backup")

    make_folder(folder)
    with tarfile.open(fileobj=file, mode="r:") as archive:
        manifest = _read_manifest(archive, backup)
        if site not in (None, manifest.site):
            raise BackupError(
                f"{backup} is a backup of the site '{manifest.site}', and the configuration is that of '{site}'"
            )
        if signer is not None and not is_signed(manifest.statement, manifest.signature or "", signer):
            raise BackupError(f"{backup} is not signed with that key; use a backup that is, or another key")
        missing = dict(manifest.files)
        # A backup is not compressed: what is in it cannot be larger than it is.
        if manifest.size > os.fstat(file.fileno()).st_size:
            raise damaged("it claims to hold more than there is")
        for member in archive:
            if member.name == _MANIFEST:
                continue
            described = missing.pop(member.name, None)
            content = archive.extractfile(member) if _is_plain(member) else None
            if described is None or content is None or not _NAMES.fullmatch(member.name):
                raise damaged(f"'{member.name}' does not belong into it")
            target = folder / member.name
            make_folder(target.parent)
            if member.size != described.size or _write(content, target) != described.sha256:
                raise damaged(f"'{member.name}' does not match its digest")
            sync_folder(target.parent)
        if missing:
            raise damaged(f"'{next(iter(missing))}' is missing")
    zones = {Path(name).parent for name in manifest.files if name.startswith(f"{CHECKPOINTS}/")}
    return Backup(backup, manifest.site, manifest.made, len(zones), manifest.size, signer is not None)


def _is_plain(member: tarfile.TarInfo) -> bool:
    """Whether it is a file of its own: no link to another one, no device, and without holes."""
    return member.isreg() and not member.issparse()


def _read_manifest(archive: tarfile.TarFile, backup: Path) -> _Manifest:
    try:
        member = archive.next()
        if member is None or member.name != _MANIFEST or not _is_plain(member):
            raise ValueError("another file comes first")
        content = archive.extractfile(member)
        found = from_json(b"" if content is None else content.read(_LARGEST_MANIFEST))
        if found["format"] > FORMAT_VERSION:
            raise BackupError(f"{backup} was made by a newer Thermogate; upgrade Thermogate")
    except (ValueError, KeyError, TypeError) as error:
        raise BackupError(f"{backup} is no backup of Thermogate, or damaged: it has no manifest") from error
    with suppress(ValidationError):
        manifest = _Manifest.model_validate(found)
        if JOURNAL in manifest.files:
            return manifest
    raise BackupError(f"{backup} is damaged: its manifest is not complete; use another backup")


def _write(content: IO[bytes], target: Path) -> str:
    digest = hashlib.sha256()
    # It tells when people are at home, and a configuration may hold passwords.
    with open(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        while block := content.read(_BLOCK):
            digest.update(block)
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
    return digest.hexdigest()


def _described(path: Path) -> _Content:
    with path.open("rb") as file:
        return _Content(size=path.stat().st_size, sha256=hashlib.file_digest(file, "sha256").hexdigest())


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
