"""API keys: made, listed and revoked in a file, and recognised by a running daemon. A key is 256 random bits. What is
stored is its SHA-256: nobody can search 2^256 keys, so a slow or salted hash would only make every request slower."""

import fcntl
import hashlib
import hmac
import logging
import os
import secrets
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, BaseModel, Field, ValidationError

from adapters.fields.values import Identifier
from service.errors import KeyFileError
from service.store.audit import AUDIT, about
from service.store.durable_files import make_folder, replace_file
from service.store.ownership import as_owner_of, others_can_change
from service.web.server.followed import FollowedFiles

PREFIX = "tg_"
"""How every key begins, so that people and secret scanners know one when they see it."""
SECRET_BYTES = 32
LONGEST = 2**22
"""Bytes of a file of keys, of which each takes about 250."""

Scope = Literal["read", "write", "admin"]

_log = logging.getLogger(__name__)


class Caller(BaseModel, extra="forbid", frozen=True):
    """Who asks."""

    name: str
    scope: Scope = "read"
    zones: tuple[Identifier, ...] | None = None
    """The zones that it may see; None: all."""

    def may(self, scope: Scope) -> bool:
        """Whether it may do what takes `scope`. Who may write may not read: a logger has no need to."""
        return self.scope in (scope, "admin")

    def sees(self, zone: str) -> bool:
        """Whether this zone exists for it."""
        return self.zones is None or zone in self.zones


class Key(Caller, frozen=True):
    """What is known of a key; not the key itself."""

    name: Identifier
    scope: Scope
    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$", repr=False)]
    created: AwareDatetime
    expires: AwareDatetime | None = None
    revoked: AwareDatetime | None = None

    def state(self, now: datetime) -> Literal["active", "expired", "revoked"]:
        """Whether it is accepted at `now`."""
        if self.revoked is not None:
            return "revoked"
        return "expired" if self.expires is not None and self.expires <= now else "active"


class _Content(BaseModel, extra="forbid", frozen=True):
    schema_version: Literal[1] = Field(default=1, alias="schema")
    keys: tuple[Key, ...] = ()


def read_keys(path: Path, at: Path | None = None) -> tuple[Key, ...]:
    """Every key in the file, revoked ones too; none if there is no file. KeyFileError if it cannot be trusted. `at` is
    how to reach it where that is not by `path`."""
    try:
        descriptor = os.open(at or path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            _check_trust(at or path, os.fstat(descriptor))
            with open(descriptor, "rb", closefd=False) as file:
                return _Content.model_validate_json(file.read()).keys
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        return ()
    except OSError as error:
        raise KeyFileError(
            f"the keys in {path} cannot be read ({error.strerror}); give it to the account of the daemon, and "
            "run commands about it as that account or root"
        ) from None
    except ValidationError:
        raise KeyFileError(
            f"{path} is not a file of keys, or is damaged; restore it, or move it away and create the keys anew"
        ) from None


def _check_trust(path: Path, status: os.stat_result) -> None:
    """KeyFileError unless only the daemon's account and root can change the file at `path`, or put another one in its
    place, and it is one that can be read at once."""
    if not stat.S_ISREG(status.st_mode) or status.st_size > LONGEST:
        raise KeyFileError(f"{path} is not a file of keys; move it away and create the keys anew")
    folders = {folder: folder.stat() for folder in (path.parent, path.resolve().parent)}
    # Root works for the account whose folder it is.
    trusted = {0, os.geteuid() or folders[path.parent].st_uid}
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) or status.st_uid not in trusted:
        raise KeyFileError(
            f"the keys in {path} can be changed by other accounts of this machine; look whether every key is "
            f"yours, then give it to the daemon's account, and say: chmod 600 {path}"
        )
    for folder, found in folders.items():
        if others_can_change(found, trusted):
            raise KeyFileError(
                f"the keys in {path} can be replaced by other accounts of this machine; look whether every key is "
                f"yours, then give the folder to the daemon's account, and say: chmod go-w {folder}"
            )


def create_key(
    path: Path, name: str, scope: Scope, zones: Sequence[str] | None = None, expires: datetime | None = None
) -> str:
    """Add a key to the file, in the place of a revoked or expired one of its name, and return it: the only time that
    anyone sees it. KeyFileError if the name is in use."""
    secret = PREFIX + secrets.token_urlsafe(SECRET_BYTES)
    now = datetime.now(UTC).replace(microsecond=0)
    with _changing(path) as keys:
        if any(key.name == name and key.state(now) == "active" for key in keys):
            raise KeyFileError(f"there is a key '{name}' already; choose another name, or revoke that one first")
        keys[:] = [key for key in keys if key.name != name]
        keys.append(
            Key(
                name=name,
                scope=scope,
                zones=None if zones is None else tuple(zones),
                digest=_digest(secret),
                created=now,
                expires=expires,
            )
        )
    return secret


def revoke_key(path: Path, name: str) -> None:
    """Mark a key as revoked; KeyFileError if there is none of this name, or it is revoked already."""
    with _changing(path) as keys:
        for index, key in enumerate(keys):
            if key.name == name and key.revoked is None:
                keys[index] = key.model_copy(update={"revoked": datetime.now(UTC).replace(microsecond=0)})
                return
        known = ", ".join(key.name for key in keys if key.revoked is None)
        raise KeyFileError(f"there is no key '{name}' to revoke; the keys are {known or 'none'}")


class KeyRing:
    """The keys of a file, followed while it changes."""

    def __init__(self, path: Path, *, required: bool) -> None:
        """Reads the file; KeyFileError if it cannot be trusted. `required`: keys are in force even if there is none."""
        self._path = path
        self._file = FollowedFiles(path)
        self._keys = read_keys(path)
        self._in_force = required or bool(self._keys)

    @property
    def in_force(self) -> bool:
        """Whether requests need a key: always if required, otherwise from the first key on. It stays so if keys are
        revoked or the file goes away: what took access away must not open the door."""
        self._follow()
        return self._in_force

    def find(self, secret: str) -> Key | None:
        """The active key that `secret` is; None if there is none. Takes equally long whichever it is. KeyFileError
        while nobody can say, because the file cannot be read or trusted."""
        self._follow()
        if self._file.complaint:
            raise KeyFileError("the API keys cannot be read now; the log of the daemon says why")
        digest, now = _digest(secret), datetime.now(UTC)
        found = [key for key in self._keys if hmac.compare_digest(key.digest, digest)]
        return next((key for key in found if key.state(now) == "active"), None)

    def accepts(self, key: Key) -> bool:
        """Whether `key`, found before, is still there and active."""
        self._follow()
        return not self._file.complaint and key in self._keys and key.state(datetime.now(UTC)) == "active"

    def _follow(self) -> None:
        """Read the file again if it is another one than last time, or could not be read then."""
        before, complaint = _accepted(self._keys), self._file.complaint
        # What a file that cannot be read would say may be that a key was revoked.

        def read() -> None:
            self._keys = read_keys(self._path)

        if not self._file.follow(read, "no API key is accepted"):
            return
        if complaint:
            _log.info("the keys in %s can be read again", self._path)
        self._in_force = self._in_force or bool(self._keys)
        now = _accepted(self._keys)
        for digest in now.keys() - before.keys():
            name, scope = now[digest].name, now[digest].scope
            AUDIT.info("API key '%s' with the scope %s is in force", name, scope, extra=about("key", f"key {name}"))
        for digest in before.keys() - now.keys():
            name = before[digest].name
            AUDIT.info("API key '%s' is not in force any more", name, extra=about("key", f"key {name}"))


def _accepted(keys: Sequence[Key]) -> dict[str, Key]:
    """The keys that have not been revoked, by their digests."""
    return {key.digest: key for key in keys if key.revoked is None}


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


@contextmanager
def _changing(path: Path) -> Iterator[list[Key]]:
    """The keys of the file, to be changed; written on leaving, one writer at a time."""
    try:
        make_folder(path.parent)
        # The administrator makes a key; the daemon's account, whose folder it is, has to read it.
        with as_owner_of(path.parent) as parent:
            folder = os.open(parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                fcntl.flock(folder, fcntl.LOCK_EX)
                keys = list(read_keys(path, parent / path.name))
                yield keys
                content = _Content(schema=1, keys=tuple(keys)).model_dump_json(by_alias=True, indent=2).encode()
                replace_file(parent / path.name, content)
                os.fsync(folder)
            finally:
                os.close(folder)
    except OSError as error:
        raise KeyFileError(
            f"the keys in {path} cannot be written ({error.strerror}); make its folder writable and free space on its "
            "disk"
        ) from None
