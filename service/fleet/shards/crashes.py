"""Which zones were at work when the process of their shard ended: a file beside it that outlives the process.

A zone whose sample brings down the process (a fault in compiled code, memory that is used up) would bring it down again
after every start, with all the zones beside it. Each step is noted before it begins, with the number of processes that
ended at it before, and struck out afterwards; what is noted at a start was at work when the process ended. A sample
that took MOST processes with it is passed over.
"""

import errno
import json
import logging
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import NamedTuple

from adapters.fields.times import written_time
from service.store.ownership import others_can_change

MOST = 3
"""How many processes one sample of a zone may take with it."""

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
        """Reads what the process before has left. A folder that cannot be written, or that others can change, costs the
        notes alone."""
        self._folder = folder or Path(tempfile.gettempdir()) / f"thermogate-fleet-{os.getuid()}"
        self._path = self._folder / f"{site}.{name}.steps"
        self.suspects: tuple[Suspect, ...] = ()
        """Who was at work the last time, and how often."""
        self._at_work: dict[int, Suspect] = {}
        """What each thread steps."""
        self._alone, self._lock = threading.Lock(), threading.Lock()
        self._fails = False
        self._file = -1
        try:
            self._folder.mkdir(mode=0o700, exist_ok=True)
            if others_can_change(self._folder.stat(), (0, os.geteuid())):
                # They could blame a zone, or have another file of this account emptied.
                raise PermissionError(errno.EPERM, "other accounts can change it")
            self.suspects = self._left()
            self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        except OSError as error:
            self._say(error)
        self._suspected = {(one.zone, one.time): one.crashes for one in self.suspects if one.crashes < MOST}

    @property
    def guilty(self) -> dict[str, Suspect]:
        """The zones whose sample is to blame, by name."""
        return {suspect.zone: suspect for suspect in self.suspects if suspect.crashes >= MOST}

    @contextmanager
    def stepping(self, zone: str, time: int) -> Iterator[None]:
        """While it lasts, this thread steps `zone` with the sample at `time`; alone, until the suspects are known to be
        innocent."""
        with self._alone if self._suspected else nullcontext():
            self._note(Suspect(zone, time, self._suspected.get((zone, time), 0)))
            try:
                yield
            finally:
                # An error leaves the process alive.
                self._note(None)
                self._suspected.pop((zone, time), None)

    def close(self) -> None:
        """The process ends in order; safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
        with suppress(OSError):
            self._path.unlink(missing_ok=True)

    def _note(self, step: Suspect | None) -> None:
        with self._lock:
            self._at_work.pop(threading.get_ident(), None)
            if step is not None:
                self._at_work[threading.get_ident()] = step
            if self._file >= 0:
                try:
                    # What an earlier note has left behind the end of this line means nothing.
                    os.pwrite(self._file, json.dumps([*self._at_work.values()]).encode() + b"\n", 0)
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

    def _left(self) -> tuple[Suspect, ...]:
        try:
            notes = json.loads(self._path.read_bytes().partition(b"\n")[0])
            return tuple(Suspect(str(zone), int(time), int(crashes) + 1) for zone, time, crashes in notes)
        except (OSError, ValueError, TypeError):
            return ()
