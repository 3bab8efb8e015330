"""Which zones were at work when the process of their shard ended: a file beside it that outlives the process.

A zone whose sample brings down the process (a fault in compiled code, memory that is used up) would bring it down again
after every start, with all the zones beside it. Each step is noted before it begins, with the number of processes that
ended at it before, and struck out afterwards; what is noted at a start was at work when the process ended. A sample
that took MOST processes with it is passed over.
"""

from __future__ import annotations

import logging
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import NamedTuple

from adapters.fields.times import written_time

MOST = 3
"""How many processes one sample of a zone may take with it."""

_WIDTH = 128
"""Bytes of a note."""

_log = logging.getLogger(__name__)


class Suspect(NamedTuple):
    """A zone that was at work with the sample at `time`, UTC s, when `crashes` processes ended."""

    zone: str
    time: int
    crashes: int

    def __str__(self) -> str:
        return f"{self.crashes} processes ended while it was at work with its sample at {written_time(self.time)}"


class Crashes:
    """The notes of the shard `name` of `site` on this machine. A machine that is lost takes them along: that is no
    zone's fault."""

    def __init__(self, site: str, name: str, folder: Path | None = None) -> None:
        """Reads what the process before has left. A folder that cannot be written costs the notes alone."""
        self._folder = folder or Path(tempfile.gettempdir()) / f"thermogate-fleet-{os.getuid()}"
        self._path = self._folder / f"{site}.{name}.steps"
        self.suspects = tuple(self._left())
        """Who was at work the last time, and how often."""
        self._suspected = {(one.zone, one.time): one.crashes for one in self.suspects if one.crashes < MOST}
        self._alone = threading.Lock()
        self._slots: dict[int, int] = {}
        """Place of each thread's note in the file."""
        self._lock = threading.Lock()
        self._fails = False
        self._file = -1
        try:
            self._folder.mkdir(mode=0o700, exist_ok=True)
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        except OSError as error:
            self._say(error)

    @property
    def guilty(self) -> dict[str, Suspect]:
        """The zones whose sample is to blame, by name."""
        return {suspect.zone: suspect for suspect in self.suspects if suspect.crashes >= MOST}

    @contextmanager
    def stepping(self, zone: str, time: int) -> Iterator[None]:
        """While it lasts, this thread steps `zone` with the sample at `time`; alone, until the suspects are known to be
        innocent."""
        with self._alone if self._suspected else nullcontext():
            self._note(f"{zone} {time} {self._suspected.get((zone, time), 0)}")
            try:
                yield
            finally:
                # An error leaves the process alive.
                self._note("")
                self._suspected.pop((zone, time), None)

    def close(self) -> None:
        """The process ends in order; safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
        with suppress(OSError):
            self._path.unlink(missing_ok=True)

    def _note(self, text: str) -> None:
        with self._lock:
            slot = self._slots.setdefault(threading.get_ident(), len(self._slots))
            if self._file < 0:
                return
            try:
                os.pwrite(self._file, text.encode().ljust(_WIDTH)[:_WIDTH], slot * _WIDTH)
            except OSError as error:
                self._say(error)

    def _say(self, error: OSError) -> None:
        if not self._fails:
            self._fails = True
            _log.error(
                "%s cannot be written (%s); make room there and let this account write, or a zone that brings down its "
                "process again and again cannot be found, and takes its shard along every time",
                self._folder,
                error.strerror,
            )

    def _left(self) -> Iterator[Suspect]:
        try:
            notes = self._path.read_bytes()
        except OSError:
            return
        for first in range(0, len(notes), _WIDTH):
            words = notes[first : first + _WIDTH].decode(errors="replace").strip(" \0").split(" ")
            if len(words) == 3 and words[1].isdecimal() and words[2].isdecimal():
                yield Suspect(words[0], int(words[1]), int(words[2]) + 1)
