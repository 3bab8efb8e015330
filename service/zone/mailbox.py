"""The mailbox of a zone: bounded, in order, and never in the way of live telemetry."""

import asyncio
from collections import deque
from enum import Enum
from typing import NamedTuple

from service.records.sample import Sample

ROOM = 16
"""Samples that wait in memory at most."""


class Accepted(NamedTuple):
    """A sample that is in the journal, and when it was accepted (monotonic s)."""

    sample: Sample
    at: float


class Left(NamedTuple):
    """Samples that wait in the journal alone: from UTC s `time` on, where that is known, accepted from `at` on."""

    time: int | None
    at: float


class Mark(Enum):
    """What a mailbox tells besides samples, once everything that waits is assimilated; the first of these first."""

    SET_BACK = "the wall clock was set back"
    ENDED = "no telemetry will follow"
    CLOSED = "nothing at all will follow"


class Mailbox:
    """Samples on their way from the intake, which puts, to the worker, which gets; both in the event loop. Where there
    is no room a recording waits, and live telemetry is left to the journal until the worker has caught up with it."""

    def __init__(self) -> None:
        self._items: deque[Accepted] = deque()
        self._left: Left | None = None
        self._marks: set[Mark] = set()
        self._news, self._room = asyncio.Event(), asyncio.Event()
        self.closed = asyncio.Event()
        self.emptied = asyncio.Event()
        """Set while the worker has finished with everything and waits for more."""

    @property
    def waiting(self) -> int:
        """How much waits; what is left to the journal counts as one sample."""
        return len(self._items) + (self._left is not None)

    @property
    def waiting_since(self) -> float | None:
        """When the sample that comes next was accepted, monotonic s; None where none waits."""
        following = self._items[0] if self._items else self._left
        return None if following is None else following.at

    async def put(self, accepted: Accepted, patient: bool) -> None:
        """Leave a sample that is in the journal; one that is `patient` waits for room."""
        while patient and self._left is None and len(self._items) >= ROOM:
            self._room.clear()
            await self._room.wait()
        if self._left is not None:
            return
        if len(self._items) >= ROOM:
            self._left = Left(accepted.sample.time, accepted.at)
        else:
            self._items.append(accepted)
        self._bring()

    async def get(self) -> Accepted | Left | Mark:
        """What comes next. After a `Left` the journal has to be read to its end; samples that come meanwhile may be
        found in both places. Nothing is lost if the waiting is cancelled."""
        while True:
            if self._items:
                self._room.set()
                return self._items.popleft()
            if self._left is not None:
                left, self._left = self._left, None
                self._room.set()
                return left
            for mark in Mark:
                if mark in self._marks:
                    if mark is not Mark.CLOSED:
                        self._marks.remove(mark)
                    return mark
            self._news.clear()
            self.emptied.set()
            await self._news.wait()

    def discard(self) -> None:
        """Leave everything that waits, and what comes from now on, to the journal."""
        since = self.waiting_since
        self._left = Left(None, asyncio.get_running_loop().time() if since is None else since)
        self._items.clear()
        self._room.set()
        self._bring()

    def tell(self, mark: Mark) -> None:
        """Let the worker know of `mark`."""
        self._marks.add(mark)
        if mark is Mark.CLOSED:
            self.closed.set()
        self._bring()

    def _bring(self) -> None:
        self.emptied.clear()
        self._news.set()
