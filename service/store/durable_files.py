"""Files and folders that are still there after a power failure."""

import os
import secrets
from contextlib import suppress
from pathlib import Path

SPACE = "free space on its disk: what was set aside (reset-*, before-restore-*, *.corrupt) and old backups may go"
"""The remedy for a full disk under a state folder."""
TEMPORARY = ".tmp"
"""How the name of a file ends until it is whole."""


def make_folder(folder: Path) -> None:
    """Make `folder` and what is missing above it, durably; OSError where that fails. Only the owner can look in: what a
    daemon knows of a home tells when people are there."""
    if folder.is_dir():
        return
    make_folder(folder.parent)
    folder.mkdir(mode=0o700, exist_ok=True)
    sync_folder(folder.parent)


def sync_folder(folder: Path) -> None:
    """Make what was created, renamed and removed in `folder` durable."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_file(path: Path, content: bytes) -> None:
    """Write `content` to `path`, durable on return but for its name in the folder. Only the owner can read it; OSError
    for a link."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW
    with open(os.open(path, flags, 0o600), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def replace_file(path: Path, content: bytes) -> None:
    """As `write_file`, in one step: until then the file at `path` is as it was. What fails leaves nothing behind."""
    temporary = path.parent / f".{path.name}.{secrets.token_hex(8)}{TEMPORARY}"
    try:
        write_file(temporary, content)
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
