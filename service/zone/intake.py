"""What a zone takes in: readings become samples, samples become durable and wait in the mailbox of its worker."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from math import inf

from adapters.reading import Reading
from service.errors import ServiceError
from service.pauses import GrowingPause, within
from service.records.asker import current_asker
from service.records.receipt import Receipt
from service.records.sample import Sample
from service.store.audit import AUDIT, about
from service.store.journalling import JournalStore
from service.zone.alignment import Alignment
from service.zone.clock import PLAUSIBLE, SETTLING, WAITED_OUT, Clock
from service.zone.mailbox import Accepted, Mailbox, Mark

FIRST_PAUSE = 1.0
LONGEST_PAUSE = 60.0
GRACE = 1.0
"""How long after its end and lateness an interval of a live zone waits for what is on its way, in s."""

_log = logging.getLogger(__name__)


class Intake:
    """The way of a zone's telemetry from its sources to its mailbox, which only `service.zone.zone` empties."""

    def __init__(self, zone: str, period: float, store: JournalStore, clock: Clock) -> None:
        self.mailbox = Mailbox()
        self.alignment: Alignment | None = None
        self.live = False
        """Whether it goes by the wall clock."""
        self.trouble: dict[str, str] = {}
        """Why a source does not deliver, by its name."""
        self.writers: dict[str, str] = {}
        """Who brought the newest reading of a channel: a source, or the key that posted it."""
        self.clocks: dict[str, float] = {}
        """A recording's own time, by source."""
        self.unwritten: str | None = None
        """Why a sample cannot be made durable now."""
        self.clock = clock
        self._behind_since: float | None = None
        """Since when the wall clock has been behind the newest sample, steady s."""
        self._waited_out = max(period, WAITED_OUT)
        self._zone = zone
        self._store = store
        self._closed = False
        self._closing = asyncio.Event()
        self._under_way: set[asyncio.Task[None]] = set()
        """Samples on their way into journal and mailbox, whoever brought them."""
        self.accepting = asyncio.Lock()
        """Held while samples are on their way into journal and mailbox."""

    @property
    def aligned(self) -> Alignment:
        """The alignment of a zone that takes telemetry."""
        assert self.alignment is not None
        return self.alignment

    async def deliver(self, source: str, readings: Sequence[Reading], now: float) -> None:
        """Readings of `source`, and its clock: the samples that close by them are accepted."""
        self.trouble.pop(source, None)
        if not self.live and now > -inf:
            self.clocks[source] = now
        self.writers.update(dict.fromkeys((self._named(reading.channel) for reading in readings), f"source {source}"))
        await self.accept(self.aligned.add(source, readings, now))

    async def take(self, source: str, readings: Sequence[Reading]) -> Receipt:
        """Readings that somebody hands over once and waits to hear of: what is accepted is durable on return, the first
        of each channel and time. Raises ServiceError where nothing can be promised; then they may be handed over again.
        """
        aligned = self.aligned
        # The interval of a reading that comes a second time may have closed meanwhile.
        late = [reading.time for reading in readings if reading.time < aligned.closed_until]
        before = await self._store.run(self._store.journal.kept, self._zone, min(late), max(late)) if late else []
        if self._closed:
            raise ServiceError(f"zone '{self._zone}' is being stopped or replaced; post the readings again")
        self.trouble.pop(source, None)
        known = {(reading.channel, reading.time) for reading in before}
        fresh: dict[tuple[str, float], Reading] = {}
        faulty: list[Reading] = []
        for reading in readings:
            key = (reading.channel, reading.time)
            if key in known or key in fresh or aligned.held(*key) is not None:
                continue
            if reading.fault is None:
                fresh[key] = reading
            else:
                faulty.append(reading)
        self._note_writer(channel for channel, _ in fresh)
        faults = Counter(aligned.faults)
        samples = aligned.add(source, [*fresh.values(), *faulty], -inf)
        refused = aligned.faults - faults
        accepted = len(fresh) + len(faulty) - refused.total()
        # One that is known may have found the journal failing the first time.
        held = [found for reading in readings if (found := aligned.held(reading.channel, reading.time)) is not None]
        await self.accept(samples)
        if held:
            await self._store.keep(self._zone, held)
        return Receipt(accepted, len(readings) - len(fresh) - len(faulty), 0, refused)

    def _note_writer(self, channels: Iterable[str]) -> None:
        """The client of this task writes `channels` from now on."""
        who = current_asker().name
        for channel in dict.fromkeys(map(self._named, channels)):
            before = self.writers.get(channel)
            if before != who:
                self.writers[channel] = who
                sentence = "%s writes %s of zone '%s' from now on%s"
                known = "" if before is None else f", until now {before}"
                AUDIT.info(sentence, who, channel, self._zone, known, extra=about("writer", who))

    def _named(self, channel: str) -> str:
        """The name of a channel in the zone's network, of the id that routing goes by."""
        return channel.removeprefix(f"{self._zone}/")

    async def recall(self) -> None:
        """Take in again what `take` had accepted for intervals that had not closed when the process ended."""
        try:
            kept = await self._store.run(self._store.journal.kept, self._zone, self.aligned.closed_until)
        except ServiceError as error:
            _log.error("zone '%s': readings that were accepted cannot be read: %s", self._zone, error)
            return
        await self.accept(self.aligned.add("", kept, -inf))

    async def elapse(self, now: float) -> None:
        """The wall clock has come to `now`: the samples that close by it are accepted, readings or not."""
        await self.accept(self.aligned.elapse(now))

    def is_due(self) -> bool:
        """Whether the wall clock asks for anything of a live zone: an interval to close, or to go back."""
        if not self.live:
            return False
        now = self.clock.wall()
        return now - GRACE >= self.aligned.closes_at or self.is_ahead(now) or self._behind_since is not None

    async def keep_time(self) -> None:
        """Close the intervals that the wall clock has come past, and go back with a clock that stays behind."""
        now, steady = self.clock.wall(), self.clock.steady()
        if not self.is_ahead(now):
            self._behind_since = None
            await self.elapse(now - GRACE)
        elif self._behind_since is None:
            self._behind_since = steady
        elif steady - self._behind_since >= SETTLING:
            self._behind_since = None
            self.mailbox.tell(Mark.SET_BACK)

    def is_ahead(self, now: float) -> bool:
        """Whether the newest sample lies further ahead of wall-clock time `now` than can be waited out."""
        return now >= PLAUSIBLE and self.aligned.closed_until > now + self._waited_out

    async def end(self, source: str, after: float | None) -> None:
        """`source` has come to its end. One that had ended before this start brings no time of its own any more; it
        then ended at `after`, UTC s."""
        if source not in self.clocks and after is not None:
            self.clocks[source] = after
        self.trouble.pop(source, None)
        await self.accept(self.aligned.end(source))
        if self.aligned.ended:
            self.mailbox.tell(Mark.ENDED)

    async def accept(self, samples: Sequence[Sample]) -> None:
        """Make samples durable and hand them to the worker. Those of a live zone are nowhere else, as their intervals
        have closed: they go on also where the source that brought them is stopped meanwhile. A recording brings its own
        again."""
        if not (self.live and samples):
            await self._accept(samples)
            return
        accepting = asyncio.create_task(self._accept(samples))
        self._under_way.add(accepting)
        accepting.add_done_callback(self._under_way.discard)
        await asyncio.shield(accepting)

    async def _accept(self, samples: Sequence[Sample]) -> None:
        # Several sources and the clock bring samples; they stay in the order in which their intervals closed.
        async with self.accepting:
            if self._closed:
                return
            for sample in samples:
                accepted = Accepted(sample, time.monotonic())
                if not await self._append(sample):
                    return
                await self.mailbox.put(accepted, patient=not self.live)

    async def close(self) -> None:
        """No sample follows: what is being accepted still is, unless the journal fails; what comes later is passed
        over."""
        self._closing.set()
        async with self.accepting:
            self._closed = True
        self.mailbox.tell(Mark.CLOSED)

    async def _append(self, sample: Sample) -> bool:
        """Journal a sample, for as long as it takes: without a journal nothing may be accepted. False where it failed
        and the mailbox closes."""
        pause = GrowingPause(FIRST_PAUSE, LONGEST_PAUSE)
        while True:
            try:
                await self._store.append(self._zone, sample)
                self.unwritten = None
                return True
            except ServiceError as error:
                self.unwritten = f"it cannot accept samples: {error}; trying again every {pause.seconds:.0f} s or more"
                _log.error("zone '%s' cannot accept samples: %s", self._zone, error)
                if await within(self._closing, pause.seconds):
                    return False
                pause.grow()
