"""Checkpoints: the state of a zone on disk, whole or not at all, as one uncompressed NumPy `.npz`, never pickle:
`<directory>/<zone>/<step>.npz`. It is written to a temporary file, fsynced, renamed, and its directory fsynced, so that
a crash leaves either the old set or the new one. Beside the arrays it holds a header (format version, fingerprint,
step, meta, and what `thermogate inspect` tells of it) and a digest over all of them."""

import hashlib
import io
import json
import logging
import os
import re
import struct
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adapters.fields.values import IDENTIFIER
from service.errors import CheckpointError, StateMismatch
from service.store.durable_files import TEMPORARY, make_folder, replace_file, sync_folder
from service.store.ownership import open_plain

FORMAT_VERSION = 1
BEGINNING = 0
"""The step of a checkpoint before every sample: what a zone begins with."""
KEPT = 3
"""Checkpoints of a zone that stay."""
_HEADER = "header"
_DIGEST = "digest"
_ARRAY = "array."
DAMAGE = (
    zipfile.BadZipFile,
    OSError,
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    RuntimeError,
    TypeError,
    OverflowError,
    MemoryError,
)
"""What zipfile and NumPy raise on damaged bytes; a NotImplementedError of zipfile is a RuntimeError."""

_log = logging.getLogger(__name__)


class Checkpoint(NamedTuple):
    """The state of a zone after the sample at `step`, in UTC seconds.

    `fingerprint` identifies the network and structural options it belongs to; `arrays` are the estimator's, of any
    dtype but object; `meta` is what JSON can hold. `about` describes it to people, and nothing depends on it. `zone` is
    whose it is; a model file is of none.
    """

    fingerprint: str
    step: int
    arrays: Mapping[str, npt.NDArray[Any]]
    meta: Mapping[str, object]
    about: Mapping[str, object] = {}
    zone: str = ""

    @property
    def is_beginning(self) -> bool:
        """Whether it is what a zone begins with, before every sample: arrays without meta."""
        return not self.meta


class Found(NamedTuple):
    """A checkpoint where it is kept: what is in it, or what is wrong with it."""

    where: object
    """Its file, or words for its place."""
    step: int
    content: bytes
    checkpoint: Checkpoint | None
    damage: Exception | None = None


def examined(where: object, zone: str, step: int, content: bytes) -> Found:
    """What the bytes that are kept at `where` for `zone` at `step` hold."""
    try:
        checkpoint = decode(content, where)
        if (checkpoint.zone, checkpoint.step) != (zone, step):
            # Zones alike have the same fingerprint, and would go on with what another room has taught.
            raise ValueError(f"it is of zone '{checkpoint.zone}' at {checkpoint.step}")
    except (*DAMAGE, CheckpointError) as error:
        return Found(where, step, content, None, error)
    return Found(where, step, content, checkpoint)


class Checkpoints(ABC):
    """The newest checkpoints of all zones; blocking, from any thread. Methods may raise ServiceError."""

    @abstractmethod
    def save(self, zone: str, checkpoint: Checkpoint, *, keep_all: bool = False) -> object:
        """Write `checkpoint`, durable on return, and remove the oldest ones, unless to `keep_all`."""

    @abstractmethod
    def found(self, zone: str) -> Iterator[Found]:
        """The kept checkpoints of `zone`, newest first, damaged ones among them. Nothing is changed."""

    @abstractmethod
    def oldest(self, zone: str) -> int | None:
        """The step of the oldest kept checkpoint of `zone`; None if there is none."""

    @abstractmethod
    def set_aside(self, zone: str, after: int = BEGINNING - 1) -> None:
        """Set those aside that were taken later than `after`; by itself all of them."""

    @abstractmethod
    def _set_damaged_aside(self, zone: str, found: Found) -> None:
        """Take no notice of a damaged checkpoint any more, and say so in the log."""

    @abstractmethod
    def _mismatch(self, zone: str) -> StateMismatch:
        """What is raised of a zone whose checkpoints have another fingerprint."""

    def close(self) -> None:
        """Let go of everything, if anything is held; safe to call twice."""
        return

    def newest(self, zone: str) -> Found | None:
        """The newest sound checkpoint of `zone`, or None; the log tells which damaged ones are left out."""
        for found in self.found(zone):
            if found.checkpoint is not None:
                return found
            _log.warning("checkpoint %s is left out: %s", found.where, found.damage)
        return None

    def load(self, zone: str, fingerprint: str) -> Checkpoint | None:
        """The newest sound checkpoint of `zone`, None if there is none; damaged ones are set aside, which the log says.
        StateMismatch if it has another `fingerprint`; CheckpointError if a newer Thermogate wrote it."""
        for found in self.found(zone):
            if isinstance(found.damage, CheckpointError):
                raise found.damage
            if found.checkpoint is None:
                self._set_damaged_aside(zone, found)
            elif found.checkpoint.fingerprint != fingerprint:
                raise self._mismatch(zone)
            else:
                return found.checkpoint
        return None


class CheckpointStore(Checkpoints):
    """Checkpoints of all zones under `directory`. Every method may raise CheckpointError."""

    def __init__(self, directory: Path) -> None:
        self.path = directory

    def save(self, zone: str, checkpoint: Checkpoint, *, keep_all: bool = False) -> Path:
        """As all checkpoints; returns its file."""
        folder = self.path / zone
        target = folder / f"{checkpoint.step:012d}.npz"
        content = encode(checkpoint._replace(zone=zone))
        with _told(f"the checkpoint {target} cannot be written", "free space on its disk and make its folder writable"):
            make_folder(folder)
            for half in folder.glob(f"*{TEMPORARY}"):
                # A crash in the middle of a write has left it behind.
                half.unlink()
            replace_file(target, content)
            # Only when the new one cannot be lost any more may an old one go.
            sync_folder(folder)
            for old in [] if keep_all else _newest_first(folder)[KEPT:]:
                old.unlink()
        return target

    def files(self, zone: str) -> list[Path]:
        """The kept checkpoints of `zone`, newest first."""
        folder = self.path / zone
        with _told(f"the checkpoints in {folder} cannot be listed", "make the folder readable"):
            return _newest_first(folder)

    def zones(self) -> list[str]:
        """The zones that have a folder here; what else somebody has put there is no state."""
        names = sorted(os.listdir(self.path)) if self.path.is_dir() else []
        return [name for name in names if re.fullmatch(IDENTIFIER, name)]

    def found(self, zone: str) -> Iterator[Found]:
        """As all checkpoints; what a daemon has removed meanwhile is passed over, for it has written a newer one."""
        for path in self.files(zone):
            try:
                with open(open_plain(path), "rb") as file:
                    content = file.read()
            except FileNotFoundError:
                continue
            except OSError as error:
                remedy = "make its folder readable and writable"
                unread = CheckpointError(f"the checkpoint {path} cannot be read ({error.strerror}); {remedy}")
                yield Found(path, int(path.stem), b"", None, unread)
            else:
                yield examined(path, zone, int(path.stem), content)

    def oldest(self, zone: str) -> int | None:
        kept = self.files(zone)
        return int(kept[-1].stem) if kept else None

    def set_aside(self, zone: str, after: int = BEGINNING - 1) -> None:
        """As all checkpoints; in a folder of their own."""
        folder = self.path / zone
        files = [path for path in self.files(zone) if int(path.stem) > after]
        aside = folder / f"reset-{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}"
        if not files:
            return
        with _told(f"the checkpoints in {folder} cannot be set aside", "make the folder writable"):
            aside.mkdir()
            for path in files:
                path.rename(aside / path.name)
            sync_folder(aside)
            sync_folder(folder)

    def _set_damaged_aside(self, zone: str, found: Found) -> None:
        path = Path(str(found.where))
        aside = path.with_name(f"{path.name}.corrupt")
        with _told(f"the damaged checkpoint {path} cannot be set aside", "make its folder writable"):
            path.replace(aside)
            sync_folder(path.parent)
        _log.warning(
            "checkpoint %s is damaged (%s); set aside as %s, using the one before", path, found.damage, aside.name
        )

    def _mismatch(self, zone: str) -> StateMismatch:
        return StateMismatch(zone, self.path / zone)


def encode(checkpoint: Checkpoint) -> bytes:
    """The bytes of a checkpoint's file; CheckpointError for an array of Python objects."""
    for name, array in checkpoint.arrays.items():
        if array.dtype.hasobject:
            raise CheckpointError(f"array '{name}' of a checkpoint holds Python objects, which are never stored")
    header = {
        "format": FORMAT_VERSION,
        "fingerprint": checkpoint.fingerprint,
        "step": checkpoint.step,
        "meta": dict(checkpoint.meta),
        "about": dict(checkpoint.about),
        "zone": checkpoint.zone,
    }
    parts = {_HEADER: np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)}
    parts |= {f"{_ARRAY}{name}": np.asarray(array) for name, array in checkpoint.arrays.items()}
    buffer = io.BytesIO()
    np.savez(buffer, **parts, **{_DIGEST: _digest(parts)})  # type: ignore[arg-type]
    return buffer.getvalue()


def decode(content: bytes, path: object) -> Checkpoint:
    """The checkpoint in the bytes that lie at `path`; one of `DAMAGE`, or CheckpointError if they are too new."""
    parts: dict[str, npt.NDArray[Any]] = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
        if any(one.compress_type != zipfile.ZIP_STORED for one in members):
            raise ValueError("it is compressed, which no checkpoint is")
        if sum(one.file_size for one in members) > len(content):
            raise ValueError("it claims to hold more than there is")
        for member in archive.namelist():
            # Reading the member whole checks its CRC before anybody believes the shape it claims.
            parts[member.removesuffix(".npy")] = np.lib.format.read_array(
                io.BytesIO(archive.read(member)), allow_pickle=False
            )
    header = json.loads(parts[_HEADER].tobytes())
    if header["format"] > FORMAT_VERSION:
        raise CheckpointError(
            f"the checkpoint {path} has format {header['format']} of a newer Thermogate (this one reads "
            f"{FORMAT_VERSION}); upgrade Thermogate or use another state_dir"
        )
    digest = parts.pop(_DIGEST)
    if not np.array_equal(digest, _digest(parts)):
        raise ValueError("its content does not match its digest")
    arrays = {name.removeprefix(_ARRAY): array for name, array in parts.items() if name.startswith(_ARRAY)}
    return Checkpoint(
        header["fingerprint"],
        header["step"],
        arrays,
        header["meta"],
        header.get("about", {}),
        str(header.get("zone", "")),
    )


def _digest(parts: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[np.uint8]:
    """SHA-256 over names, dtypes, shapes and bytes, shape (32,)."""
    digest = hashlib.sha256()
    for name in sorted(parts):
        array = parts[name]
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)


@contextmanager
def _told(what: str, remedy: str) -> Iterator[None]:
    """Turn what the disk raises into one sentence."""
    try:
        yield
    except OSError as error:
        raise CheckpointError(f"{what} ({error.strerror}); {remedy}") from error


def _newest_first(folder: Path) -> list[Path]:
    # Not by `glob`, which passes over a folder that may not be read, and some that cannot.
    paths = folder.iterdir() if folder.is_dir() else ()
    return sorted(
        (path for path in paths if path.suffix == ".npz" and path.stem.isdecimal()),
        key=lambda p: int(p.stem),
        reverse=True,
    )
