"""Folders that another account can change: whom to trust, and root at work where links may lie that lead anywhere."""

import codecs
import errno
import os
import pwd
import sqlite3
import stat
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from service.errors import ServiceError


@contextmanager
def as_owner_of(folder: Path) -> Iterator[Path]:
    """Act, if this is root, with the rights of the account that owns `folder`, and give the path to reach it by
    meanwhile: no link in it leads to what that account may not reach itself, and what is made belongs to it."""
    owner = folder.stat()
    if not _is_foreign(owner):
        yield folder
        return
    # For names in a checkpoint: by then, Python's own files may be out of reach.
    codecs.lookup("cp437")
    here = os.open(".", os.O_RDONLY | os.O_DIRECTORY)
    group, groups = os.getegid(), os.getgroups()
    try:
        os.chdir(folder)
        os.setgroups([])
        os.setegid(owner.st_gid)
        os.seteuid(owner.st_uid)
        yield Path()
    finally:
        os.seteuid(0)
        os.setegid(group)
        os.setgroups(groups)
        os.fchdir(here)
        os.close(here)


def refuse_root(folder: Path) -> None:
    """ServiceError where this is root and another account owns `folder`: it could not read what root makes in there."""
    if folder.is_dir() and _is_foreign(owner := folder.stat()):
        try:
            account = f"the account {pwd.getpwuid(owner.st_uid).pw_name}"
        except KeyError:
            account = f"account {owner.st_uid}"
        raise ServiceError(
            f"{folder} belongs to {account}, which could not read what root learns; run this as that account, as "
            "docs/operations.md says under History"
        )


def _is_foreign(folder: os.stat_result) -> bool:
    """Whether this is root, in a folder of another account."""
    return os.geteuid() == 0 and folder.st_uid != 0


def others_can_change(folder: os.stat_result, trusted: Collection[int]) -> bool:
    """Whether an account beside the `trusted` ones (user ids) can put files into `folder`, or others in their place.
    The groups of this process are trusted, and a folder such as /tmp, where each account replaces its own files
    alone."""
    own_group = folder.st_gid in (os.getegid(), *os.getgroups())
    writable = folder.st_mode & (stat.S_IWOTH if own_group else stat.S_IWGRP | stat.S_IWOTH)
    return bool(writable and not folder.st_mode & stat.S_ISVTX) or folder.st_uid not in trusted


def open_plain(path: Path, flags: int = os.O_RDONLY) -> int:
    """A descriptor of the plain file at `path`; OSError for a link, and at once for a pipe or a device."""
    try:
        descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o600)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO):
            raise _no_plain_file(path) from None
        raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise _no_plain_file(path)
    return descriptor


@contextmanager
def database(path: Path, *, alone: bool = False) -> Iterator[sqlite3.Connection]:
    """A connection that only reads the SQLite file at `path`; OSError for a link. A journal of another account may be
    made to do harm: what a file beside it asks for, down to deleting any other file, is done on a connection that
    writes. Nor is such a file looked at where the database is `alone`, which nobody writes to. SQLite follows links, so
    what it has opened is compared."""
    expected = path.lstat()
    if not stat.S_ISREG(expected.st_mode):
        raise _no_plain_file(path)
    before = _open_files()
    how = "mode=ro&immutable=1" if alone else "mode=ro"
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?{how}", uri=True, isolation_level=None)) as connection:
        after = _open_files()
        if (expected.st_dev, expected.st_ino) not in [after[number] for number in after.keys() - before.keys()]:
            raise _no_plain_file(path)
        connection.execute("PRAGMA trusted_schema = OFF")
        yield connection


def _no_plain_file(path: Path) -> OSError:
    return OSError(errno.EINVAL, f"{path.name} is a link or another kind of file; look who has put it there")


def _open_files() -> dict[str, tuple[int, int]]:
    """What the descriptors of this process lead to, as device and inode."""
    found = {}
    for number in os.listdir("/proc/self/fd"):
        # The descriptor of this listing is closed by now.
        with suppress(OSError):
            status = os.stat(f"/proc/self/fd/{number}")
            found[number] = status.st_dev, status.st_ino
    return found
