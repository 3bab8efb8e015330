"""Which zones were at work when the process of their shard ended: a file beside it that outlives the process.

A zone whose sample brings down the process (a fault in compiled code, memory that is used up) would bring it down again
after every start, with all the zones beside it. Each step is noted before it begins and struck out afterwards; what is
noted at a start was at work when the process ended. Whoever was, with the same sample, MOST times, is to blame.
"""

from __future__ import annotations

import json
import logging
import os
import tempfile
import threading
from collections.abc import Iterator, Mapping
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


def told(suspect: Suspect) -> str:
    """What a zone is suspected of."""
    return f"{suspect.crashes} processes ended while it was at work with its sample at {written_time(suspect.time)}"


class Crashes:
    """The notes of the shard `name` of `site` on this machine. A machine that is lost takes them along: that is no
    zone's fault."""

    def __init__(self, site: str, name: str, folder: Path | None = None) -> None:
        """Reads what the process before has left. A folder that cannot be written costs the notes alone."""
        self._folder = folder or Path(tempfile.gettempdir()) / f"thermogate-fleet-{os.getuid()}"
        self._at_work = self._folder / f"{site}.{name}.steps"
        self._counts = self._folder / f"{site}.{name}.crashes"
        self.suspects = self._judged()
        """Who was at work the last time, and how often."""
        self._suspected = {(suspect.zone, suspect.time) for suspect in self.suspects if suspect.crashes < MOST}
        self._alone = threading.Lock()
        self._slots: dict[int, int] = {}
        """Place of each thread's note in the file."""
        self._lock = threading.Lock()
        self._fails = False
        self._file = -1
        try:
            self._file = self._begun()
        except OSError as error:
            self._say(error)

    @property
    def guilty(self) -> Mapping[str, Suspect]:
        """The zones that are to blame, by name."""
        return {suspect.zone: suspect for suspect in self.suspects if suspect.crashes >= MOST}

    @contextmanager
    def stepping(self, zone: str, time: int) -> Iterator[None]:
        """While it lasts, this thread steps `zone` with the sample at `time`; alone, until the suspects are known to be
        innocent."""
        with self._alone if self._suspected else nullcontext():
            self._note(f"{zone} {time}")
            try:
                yield
            finally:
                # An error leaves the process alive.
                self._note("")
                self._suspected.discard((zone, time))

    def close(self) -> None:
        """The process ends in order; safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
        with suppress(OSError):
            for path in (self._at_work, self._counts):
                path.unlink(missing_ok=True)

    def _begun(self) -> int:
        """The file of notes, empty, once what it held is counted. Raises OSError, and then it holds that still."""
        self._folder.mkdir(mode=0o700, exist_ok=True)
        file = os.open(self._at_work, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            self._keep(self.suspects)
            os.ftruncate(file, 0)
        except OSError:
            os.close(file)
            raise
        return file

    def _note(self, text: str) -> None:
        thread = threading.get_ident()
        with self._lock:
            slot = self._slots.setdefault(thread, len(self._slots))
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

    def _judged(self) -> tuple[Suspect, ...]:
        before: dict[tuple[str, int], int] = {}
        with suppress(OSError, ValueError, TypeError):
            before = {(zone, time): count for zone, time, count in json.loads(self._counts.read_text(encoding="utf-8"))}
        try:
            notes = self._at_work.read_bytes()
        except OSError:
            return ()
        found = []
        for first in range(0, len(notes), _WIDTH):
            zone, _, time = notes[first : first + _WIDTH].decode(errors="replace").strip(" \0").partition(" ")
            if time.isdecimal():
                found.append(Suspect(zone, int(time), before.get((zone, int(time)), 0) + 1))
        return tuple(found)

    def _keep(self, suspects: tuple[Suspect, ...]) -> None:
        temporary = self._counts.with_suffix(".tmp")
        temporary.write_text(json.dumps(suspects), encoding="utf-8")
        temporary.replace(self._counts)
