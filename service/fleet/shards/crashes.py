"""Which zones were at work when the process of their shard ended: a file beside it that outlives the process.

A zone whose sample brings down the process (a fault in compiled code, memory that is used up) would bring it down again
after every start, with all the zones beside it. Each step is noted before it begins and struck out afterwards; what is
noted at a start was at work when the process ended. Whoever was, with the same sample, MOST times, is to blame.
"""

from __future__ import annotations

import json
import os
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import NamedTuple

from service.fields.times import written_time

MOST = 3
"""How many processes one sample of a zone may take with it."""

_WIDTH = 128
"""Bytes of a note."""


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
        """Reads what the process before has left."""
        folder = folder or Path(tempfile.gettempdir()) / f"thermogate-fleet-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        self._at_work = folder / f"{site}.{name}.steps"
        self._counts = folder / f"{site}.{name}.crashes"
        self.suspects = self._judged()
        """Who was at work the last time, and how often."""
        self._suspected = {(suspect.zone, suspect.time) for suspect in self.suspects if suspect.crashes < MOST}
        self._alone = threading.Lock()
        self._keep(self.suspects)
        self._file = os.open(self._at_work, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        self._slots: dict[int, int] = {}
        """Place of each thread's note in the file."""
        self._lock = threading.Lock()

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
        for path in (self._at_work, self._counts):
            path.unlink(missing_ok=True)

    def _note(self, text: str) -> None:
        thread = threading.get_ident()
        with self._lock:
            slot = self._slots.setdefault(thread, len(self._slots))
            if self._file >= 0:
                os.pwrite(self._file, text.encode().ljust(_WIDTH)[:_WIDTH], slot * _WIDTH)

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
