"""The audit trail: one JSON object a line, each with a `link`, the SHA-256 of the link before it and of the rest of the
line, which tells what is changed, removed or damaged later. Daemon and commands append to one file in the state folder,
which is exchanged for an empty one when it is large."""

import fcntl
import hashlib
import json
import logging
import os
import pwd
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from adapters.fields.times import written_to_the_millisecond
from service.store.ownership import as_owner_of, open_plain

TRAIL, OLDER = "audit.jsonl", "audit.1.jsonl"
LARGEST = 2**25
"""Bytes from which a new file is begun; the one before it is kept, the one before that is not."""
AUDIT = logging.getLogger("audit")
"""Where events are logged, each with the `extra` of `about`. They are in the log as well, at its level."""
AUDIT.setLevel(logging.INFO)

_LINK = re.compile(rb', "link": "([0-9a-f]{64})"}\n?\Z')
"""How a line ends."""
_TAIL = 128
"""Bytes that hold at least that."""

_log = logging.getLogger(__name__)


def about(event: str, who: str) -> dict[str, str]:
    """The `extra` of a log record: a stable name of the event, and the key, client, zone or account behind it."""
    return {"event": event, "who": who}


class Trail:
    """The trail in a state folder, as the stream of a logging handler that writes whole lines of JSON objects."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, line: str) -> None:
        """Append a line. What cannot be written is lost, which the log tells: nobody waits for a full disk."""
        try:
            with _opened(self._folder) as descriptor:
                end = _end(descriptor, self._folder)
                body = line.encode().rstrip().removesuffix(b"}")
                # A line that a power failure has cut off stays one of its own.
                begin = b"" if not end or end.endswith(b"\n") else b"\n"
                os.write(descriptor, b'%s%s, "link": "%s"}\n' % (begin, body, _link(_link_in(end), body)))
        except OSError as error:
            _log.error("the audit trail in %s cannot be written: %s", self._folder, error.strerror)

    def flush(self) -> None:
        """Nothing is kept back."""


def note(folder: Path, event: str, sentence: str) -> None:
    """Append to the trail in the state `folder` what the account of this process does there; nothing where there is no
    such folder."""
    if not folder.is_dir():
        return
    try:
        who = f"account {pwd.getpwuid(os.getuid()).pw_name}"
    except KeyError:
        who = f"account {os.getuid()}"
    now = written_to_the_millisecond(datetime.now(UTC).timestamp())
    with as_owner_of(folder) as reached:
        Trail(reached).write(json.dumps({"time": now, "message": sentence, **about(event, who)}))


def broken_links(folder: Path) -> tuple[int, list[str]]:
    """How many lines the trail in the state `folder` has, and a sentence for each that does not follow."""
    count, problems, before = 0, [], b""
    for name in (OLDER, TRAIL):
        try:
            with open(open_plain(folder / name), "rb") as file:
                lines = file.read().splitlines()
        except FileNotFoundError:
            continue
        for number, line in enumerate(lines, 1):
            link, body = _link_in(line), _LINK.sub(b"", line)
            # What the first line of the older file follows is gone.
            if link != _link(before, body) and (number > 1 or name == TRAIL):
                problems.append(f"the audit trail {folder / name}: line {number} was changed, or one before it removed")
            before = link
        count += len(lines)
    return count, problems


@contextmanager
def _opened(folder: Path) -> Iterator[int]:
    """A descriptor of the trail in `folder`, which no other process writes to meanwhile."""
    path = folder / TRAIL
    while True:
        descriptor = open_plain(path, os.O_RDWR | os.O_APPEND | os.O_CREAT)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            status = os.fstat(descriptor)
            if status.st_size > LARGEST:
                path.rename(folder / OLDER)
            elif path.exists() and path.stat().st_ino == status.st_ino:
                yield descriptor
                return
        finally:
            os.close(descriptor)


def _end(descriptor: int, folder: Path) -> bytes:
    """The end of the newest line; nothing where there is none."""
    end = os.pread(descriptor, _TAIL, max(0, os.fstat(descriptor).st_size - _TAIL))
    if not end and (folder / OLDER).exists():
        with open(open_plain(folder / OLDER), "rb") as older:
            older.seek(-min(_TAIL, os.fstat(older.fileno()).st_size), os.SEEK_END)
            end = older.read()
    return end


def _link_in(line: bytes) -> bytes:
    found = _LINK.search(line)
    return b"" if found is None else found[1]


def _link(before: bytes, body: bytes) -> bytes:
    return hashlib.sha256(before + body).hexdigest().encode()
