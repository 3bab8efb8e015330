"""What a zone takes in: readings become samples, samples become durable and wait in the mailbox of its worker."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterable

from adapters.reading import Reading
from service.alignment import Alignment
from service.errors import ServiceError
from service.mailbox import Accepted, Mailbox
from service.records import Sample
from service.store import Store

FIRST_PAUSE = 1.0
LONGEST_PAUSE = 60.0

_log = logging.getLogger(__name__)


class ZoneIntake:
    """The way of a zone's telemetry from its sources to its mailbox, which only `service.zone` empties."""

    def __init__(self, zone: str, store: Store) -> None:
        self.mailbox = Mailbox()
        self.alignment: Alignment | None = None
        self.live = False
        self.trouble: dict[str, str] = {}
        """Why a source does not deliver, by its name."""
        self.clocks: dict[str, float] = {}
        """A recording's own time, by source."""
        self.unwritten: str | None = None
        """Why a sample cannot be made durable now."""
        self._zone = zone
        self._store = store
        self._accepting = asyncio.Lock()
        self._closed = False

    def align(self, alignment: Alignment, live: bool) -> None:
        """Take telemetry through `alignment` from now on; a `live` zone goes by the wall clock."""
        self.alignment, self.live = alignment, live

    async def deliver(self, source: str, readings: Iterable[Reading], now: float) -> None:
        """Readings of `source`, and its clock: the samples that close by them are accepted."""
        assert self.alignment is not None
        self.trouble.pop(source, None)
        if not self.live:
            self.clocks[source] = now
        await self.accept(self.alignment.add(source, readings, now))

    async def elapse(self, now: float) -> None:
        """The wall clock has come to `now`: the samples that close by it are accepted, readings or not."""
        assert self.alignment is not None
        await self.accept(self.alignment.elapse(now))

    async def end(self, source: str, after: float | None) -> None:
        """`source` has come to its end. One that had ended before this start brings no time of its own any more; it
        then ended at `after`, UTC s."""
        assert self.alignment is not None
        if source not in self.clocks and after is not None:
            self.clocks[source] = after
        self.trouble.pop(source, None)
        await self.accept(self.alignment.end(source))
        if self.alignment.ended:
            self.mailbox.end()

    async def accept(self, samples: Iterable[Sample]) -> None:
        """Make samples durable and hand them to the worker."""
        # Several sources and the clock bring samples; they stay in the order in which their intervals closed.
        async with self._accepting:
            if self._closed:
                return
            for sample in samples:
                accepted = Accepted(sample, time.monotonic())
                await self._append(sample)
                await self.mailbox.put(accepted, patient=not self.live)

    async def close(self) -> None:
        """No sample follows: what is being accepted still is, what comes later is passed over."""
        async with self._accepting:
            self._closed = True
        self.mailbox.close()

    async def _append(self, sample: Sample) -> None:
        """Journal a sample, for as long as it takes: without a journal nothing may be accepted."""
        pause = FIRST_PAUSE
        while True:
            try:
                await self._store.append(self._zone, sample)
                self.unwritten = None
                return
            except ServiceError as error:
                self.unwritten = f"it cannot accept samples: {error}; trying again every {pause:.0f} s or more"
                _log.error("zone '%s' cannot accept samples: %s", self._zone, error)
                await asyncio.sleep(pause)
                pause = min(2 * pause, LONGEST_PAUSE)
