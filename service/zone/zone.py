"""One zone inside the daemon: its worker, fed from its mailbox, and what happens when the worker fails.

A sample is journaled when it is accepted and assimilated from the mailbox, strictly in order. The worker is restored
from its newest checkpoint, and stepped over what the journal holds beyond that; the journal keeps everything that is
later than the oldest checkpoint, so that one which is damaged costs time and nothing else. When a step fails, the zone
is restored after a pause that grows; meanwhile samples go on into the journal, so that nothing is lost and no other
zone waits. A sample on which the zone fails repeatedly is marked in the journal and passed over, unless it is the
environment that fails.
"""

import asyncio
import logging
import time
from collections.abc import Callable
from functools import partial
from math import inf

from estimator.types import ALPHA_LEVELS
from service.errors import ServiceError, StateMismatch
from service.pauses import GrowingPause, within
from service.publish.sinks import Announcement, Occasion, Reports, tell
from service.records.history import HistoryRow
from service.records.outlook import NO_SURROUNDINGS, Surroundings, Weather
from service.records.sample import Sample
from service.records.series import Series, Stretch
from service.records.status import Busy, ZoneState, ZoneStatus
from service.records.update import Update
from service.records.view import Answer, Question
from service.store.checkpoint import Checkpoint
from service.store.database import Result
from service.store.series import bucket_of
from service.zone import snapshot
from service.zone.alignment import Alignment
from service.zone.clock import MOST_SET_ASIDE
from service.zone.health import state_and_reason, telemetry_news
from service.zone.intake import FIRST_PAUSE, LONGEST_PAUSE, Intake
from service.zone.mailbox import Left, Mark
from service.zone.plumbing import Plumbing
from service.zone.recovery import first_checkpoint, is_of_the_environment, next_moment
from service.zone.timeliness import Timeliness
from service.zone.worker import ZoneWorker

ATTEMPTS = 3

_SET_BACK = "the clock of this machine was set back; waiting for the next sample"
_HOUR = 3600

_log = logging.getLogger(__name__)


class Zone:
    """A running zone; also what REST, metrics and the publisher see of it (`service.records.view.ZoneView`)."""

    def __init__(
        self,
        name: str,
        estimator: str,
        fingerprint: str,
        worker: ZoneWorker,
        plumbing: Plumbing,
        surroundings: Surroundings = NO_SURROUNDINGS,
        neighbours: Callable[[], Checkpoint | None] = lambda: None,
    ) -> None:
        """`worker` has seen nothing yet; `fingerprint` is what stored state of the zone belongs to. `neighbours` makes
        the checkpoint that the zone begins with before its first sample. It blocks."""
        self.id = name
        self.surroundings = surroundings
        """What is known of its inputs; a reload may change it while the zone goes on."""
        self.estimator = estimator
        self._plumbing, self._store, self._neighbours = plumbing, plumbing.store, neighbours
        self.worker = worker
        """What it has learned with; another one after a failure."""
        self.network = worker.network
        self.period = float(worker.period)
        self.fingerprint = fingerprint
        self.intake = Intake(name, self.period, plumbing.store, plumbing.clock)
        self._failure: str | None = None
        self._at: int | None = None
        """Time of the sample that is being assimilated; None between two."""
        self._timeliness = Timeliness(name)
        self._finished = 0
        """How many samples were assimilated, or could not be."""
        self.empty_samples = 0
        """Samples in a row without a reading, up to the last accepted before `prepare`; 0 if not known."""
        self._announced: tuple[int | None, tuple[str, ...]] = None, ()
        """The hour in which skill and heat loss, and the trust in every horizon, as they were last announced."""
        self._hurried = False
        self._ended = False
        """Whether the last sample of the last source has been assimilated."""
        self._unsaved = False
        """Whether the worker has gone on since the last checkpoint."""
        self._due = self._next_checkpoint()
        """When the next checkpoint is due, monotonic s."""

    def now(self) -> ZoneState:
        return ZoneState.of(self._status(), self.worker.latest, self.worker.trust)

    def _status(self) -> ZoneStatus:
        # Copied in one go: the event loop may change them while a worker thread asks.
        progress, intake = self.worker.progress, self.intake
        alignment, trouble, clocks = intake.alignment, tuple(intake.trouble.values()), tuple(intake.clocks.values())
        if intake.live and alignment and (refusing := sorted(set(alignment.refusing))):
            trouble = (*trouble, f"the device refuses {', '.join(refusing)}; the log says why")
        state, reason = state_and_reason(
            progress,
            has_forecast=self.worker.latest is not None,
            failure=self._failure or intake.unwritten,
            trouble=trouble,
            live=intake.live,
            ended=self._ended,
            now=self._plumbing.clock.wall(),
            lag=self._timeliness.lag(intake.mailbox.waiting_since),
        )
        return ZoneStatus(
            state=state,
            reason=reason,
            last_sample_time=progress.last_time,
            samples=progress.samples,
            segment=progress.segment,
            faults={str(fault): count for fault, count in dict(alignment.faults).items()} if alignment else {},
            last_good=dict(alignment.last_good) if alignment else {},
            writers=dict(intake.writers),
            channels=alignment.channels if alignment else self.network.channels,
            now=min(clocks, default=None),
            overruns=self._timeliness.overruns,
            delay=self._timeliness.delay,
            diagnosis=self.worker.carried.diagnosis,
        )

    @property
    def busy(self) -> Busy:
        """What waits, and what was finished."""
        return Busy(self.intake.mailbox.waiting + (self._at is not None), self._finished)

    async def ask(self, question: Question[Answer]) -> Answer:
        """The answer to a question, found on a thread for questions so that no zone waits for it."""
        return await self._plumbing.asking.ask(partial(question, self.worker, self._weather))

    @property
    def _weather(self) -> Weather:
        return Weather(self.surroundings.weather, self._plumbing.weather)

    async def history(self, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """History rows, oldest first."""
        return await self._store.run(self._store.journal.history, self.id, start, end, limit)

    async def series(self, start: int, end: int, points: int) -> Series:
        """The history of [start, end), UTC s, thinned out."""
        period = int(self.period)
        bucket = bucket_of(start, end, period, points)
        stretch = Stretch(self.id, start, end, period, bucket, len(self.network.inputs))
        return await self._store.series(stretch)

    async def restore(self) -> int | None:
        """Rebuild the worker from checkpoint and journal; the time of the last accepted sample.

        Raises StateMismatch where the stored state belongs to another network.
        """
        worker, store = self.worker.anew(), self._store
        await store.claim(self.id, self.fingerprint)
        checkpoint = await self._in_pool(store.checkpoints.load, self.id, self.fingerprint)
        if checkpoint is None:
            checkpoint = await first_checkpoint(store, self.id, self._neighbours)
        if checkpoint is not None:
            snapshot.restore(worker, checkpoint)
        at = None if checkpoint is None or checkpoint.is_beginning else checkpoint.step
        self._unsaved = False
        replayed = await self._catch_up(worker)
        self.worker = worker
        if at is not None or replayed:
            say = "zone '%s' goes on after %d samples, %d intervals replayed from the journal"
            _log.info(say, self.id, worker.progress.samples, replayed)
        return await store.resume_after(self.id, at)

    def align(self, alignment: Alignment, live: bool = False, pace: float = inf) -> None:
        """Take telemetry through `alignment` from now on, once `prepare` is done. A `live` zone goes by the wall clock,
        not by what its sources say the time is; a recording is played at so many times its `pace`."""
        self.intake.alignment, self.intake.live = alignment, live
        self._timeliness.patience = self.period if live else inf if pace == inf else self.period / pace

    async def end(self, source: str) -> None:
        """`source` has come to its end."""
        last = self.worker.progress.last_time
        await self.intake.end(source, None if last is None else last + self.period)

    async def source_failed(self, source: str, reason: str) -> None:
        """`source` does not deliver for now, and why."""
        self.intake.trouble[source] = reason
        await self._in_pool(self._announce, Occasion.STATUS)

    async def settled(self) -> None:
        """Wait until everything that has been accepted is assimilated, while `run` is under way."""
        async with self.intake.accepting:
            pass
        await self.intake.mailbox.emptied.wait()

    async def prepare(self) -> int | None:
        """Restore before any source starts; the time of the last accepted sample. A failure other than StateMismatch
        leaves the zone failed, to be retried by `run`."""
        try:
            last = await self.restore()
            if last == self.worker.progress.last_time:
                self.empty_samples = self.worker.empty_samples
            if self._unsaved:
                # The next start need not replay the same samples again.
                await self._save()
            return last
        except StateMismatch:
            raise
        except Exception as error:
            self._fail(error, FIRST_PAUSE)
            return await self._store.run(self._store.journal.last_sample_time, self.id)

    def hurry(self) -> None:
        """End `run` after the present sample, with a checkpoint; the journal keeps the rest for the next start."""
        self._hurried = True

    async def run(self) -> None:
        """Serve the mailbox, in order, until it is closed; then write a checkpoint."""
        pause, failed_on, attempts = GrowingPause(FIRST_PAUSE, LONGEST_PAUSE), None, 0
        while True:
            try:
                if self._failure is not None:
                    await self.restore()
                    # What was accepted meanwhile is left to the journal, and comes next.
                    self._failure = None
                    _log.info("zone '%s' has recovered", self.id)
                    pause.reset()
                await self._serve()
                return
            except StateMismatch:
                raise
            except Exception as error:
                attempts = attempts + 1 if failed_on == self._at else 1
                failed_on, self._at = self._at, None
                self._fail(error, pause.seconds)
                if failed_on is not None and attempts >= ATTEMPTS and not is_of_the_environment(error):
                    await self._skip(failed_on, f"failed {ATTEMPTS} times: {error}")
                if await within(self.intake.mailbox.closed, pause.seconds):
                    return
                pause.grow()

    async def _serve(self) -> None:
        # What was restored is announced, so that a late joiner need not wait for the next sample.
        await self._in_pool(self._announce, Occasion.RESTORED)
        while not self._hurried:
            self._timeliness.rest()
            try:
                async with asyncio.timeout(self._due - time.monotonic() if self._unsaved else None):
                    item = await self.intake.mailbox.get()
            except TimeoutError:
                await self._save()
                continue
            if item is Mark.CLOSED:
                break
            if item is Mark.ENDED:
                self._ended = True
                if faults := self._status().faults:
                    counts = ", ".join(f"{count} {fault}" for fault, count in faults.items())
                    _log.warning("zone '%s': readings refused: %s", self.id, counts)
                await self._in_pool(self._announce, Occasion.STATUS)
            elif item is Mark.SET_BACK:
                if await self._set_back():
                    await self._in_pool(self._announce, Occasion.STATUS)
            elif isinstance(item, Left):
                await self._catch_up(self.worker, item)
            else:
                last = self.worker.progress.last_time
                # After a recovery the mailbox may still hold what the journal has already brought.
                if last is None or item.sample.time > last:
                    await self._step(self.worker, item.sample, item.at)
        # A source that was stopped between journal and mailbox leaves its last sample in the journal alone.
        await self._catch_up(self.worker)
        await self._save()

    async def _step(self, worker: ZoneWorker, sample: Sample, accepted: float | None) -> None:
        """Take `worker` over a sample that was `accepted` then (monotonic s); None where that is long ago."""
        if self._unsaved and time.monotonic() >= self._due:
            await self._save(worker)
        self._at = sample.time
        if accepted is not None:
            self._timeliness.begin(accepted)
        update = await self._in_pool(self._work, worker, sample)
        self._at, self._unsaved = None, True
        self._finished += 1
        if update is not None:
            self._store.record(self.id, update)

    def _work(self, worker: ZoneWorker, sample: Sample) -> Update | None:
        """In a worker thread: one step, and its publication while the worker is the zone's own."""
        suspected = worker.carried.suspicions
        with self._plumbing.stepping(self.id, sample.time):
            update = worker.step(sample)
        if worker is self.worker:
            for level, text in telemetry_news(worker.network, suspected, worker.carried.suspicions, sample.time):
                _log.log(level, "zone '%s': %s", self.id, text)
            self._timeliness.published()
            self._announce(Occasion.STATUS if update is None else Occasion.UPDATE)
        return update

    async def _catch_up(self, worker: ZoneWorker, left: Left | None = None) -> int:
        """Step `worker` through what the journal holds beyond it; how many samples that were. `left` says when those
        were accepted for which there was no room."""
        caught_up = 0
        while samples := await self._store.samples_after(self.id, worker.progress.last_time):
            for sample in samples:
                if self._hurried:
                    return caught_up
                await self._step(worker, sample, None if left is None else self._accepted(left, sample))
                caught_up += 1
        return caught_up

    def _accepted(self, left: Left, sample: Sample) -> float:
        """When `sample` was accepted, monotonic s: one came after the other at the pace of the telemetry."""
        if left.time is None or self._timeliness.patience == inf:
            return left.at
        return left.at + (sample.time - left.time) / self.period * self._timeliness.patience

    async def _in_pool(self, function: Callable[..., Result], *arguments: object) -> Result:
        return await asyncio.get_running_loop().run_in_executor(self._plumbing.pool, function, *arguments)

    def _announce(self, occasion: Occasion) -> None:
        """Tell the sinks; that one cannot be reached must not stop the zone, nor the others."""
        update, skill, heat_loss = self.worker.latest, None, None
        hour, trusted = self._announced
        if update is not None and occasion is not Occasion.STATUS and update.time // _HOUR != hour:
            hour, skill = update.time // _HOUR, self.worker.skill()
            heat_loss = self.worker.heat_loss(ALPHA_LEVELS)
        state = self.now()
        levels = tuple(one.level for one in state.trust.horizons)
        news = state.trust if skill is not None or levels != trusted else None
        self._announced = hour, levels
        reports = Reports(skill, heat_loss, news)
        tell(self._plumbing.sinks, Announcement(self._plumbing.site, self.id, state, occasion, reports))

    def _fail(self, error: Exception, pause: float) -> None:
        self._finished += 1
        self._failure = f"{error or type(error).__name__}; trying again every {pause:.0f} s or more"
        self.intake.mailbox.discard()
        self._timeliness.rest()
        self._plumbing.metrics.failed(self.id)
        _log.error("zone '%s' failed: %s", self.id, error, exc_info=_log.isEnabledFor(logging.DEBUG))
        self._announce(Occasion.STATUS)

    async def _skip(self, when: int, reason: str) -> None:
        """Mark the sample at `when` as one that is not to be assimilated."""
        _log.error("zone '%s' passes over its sample at %d, which %s", self.id, when, reason)
        try:
            await self._store.run(self._store.journal.skip, self.id, when, reason)
        except ServiceError as failure:
            _log.error("zone '%s': %s", self.id, failure)

    async def _save(self, worker: ZoneWorker | None = None) -> None:
        """Write a checkpoint of the worker, or another; if that fails, the journal holds all since the last one."""
        checkpoint = snapshot.take(worker or self.worker, self.fingerprint, self.estimator)
        self._due = self._next_checkpoint()
        if checkpoint is None:
            return
        try:
            await self._store.run(self._store.journal.flush)
            await self._in_pool(self._store.checkpoints.save, self.id, checkpoint)
            self._unsaved = False
            self._plumbing.metrics.checkpointed(self.id, written=True)
        except ServiceError as error:
            self._plumbing.metrics.checkpointed(self.id, written=False)
            _log.error("zone '%s': %s", self.id, error)

    def _next_checkpoint(self) -> float:
        return next_moment(self.id, self._plumbing.checkpoint_every, time.monotonic())

    async def _set_back(self) -> bool:
        """Go back to the present time, where the wall clock was set back by more than can be waited out; whether that
        was done. The samples that lie ahead of the clock were dated by one that was wrong: they are set aside, what was
        learned from them is kept, and a new segment begins. If they were more than MOST_SET_ASIDE, it is the clock that
        is wrong, and nothing is done. Raises ServiceError, and then the zone has to be restored."""
        worker, intake, store = self.worker, self.intake, self._store
        async with intake.accepting:
            now = intake.clock.wall()
            if intake.mailbox.waiting or not intake.is_ahead(now):
                return False
            last = intake.aligned.last_before(now)
            ahead = await store.run(store.journal.samples_ahead, self.id, last)
            if ahead * worker.period > MOST_SET_ASIDE:
                _log.error(
                    "zone '%s': %d samples lie ahead of the clock of this machine, too many to set aside; set the "
                    "clock, or give the zone's state up with --reset",
                    self.id,
                    ahead,
                )
                return False
            before = snapshot.take(worker, self.fingerprint, self.estimator)
            worker.set_back(last, _SET_BACK)
            after = snapshot.take(worker, self.fingerprint, self.estimator)
            await store.set_back(self.id, before, after, last)
            intake.aligned.set_back(now)
        _log.warning(
            "zone '%s': the clock was set back; %d samples that lie ahead of it were set aside, and a new segment "
            "begins with the next sample",
            self.id,
            ahead,
        )
        return True
