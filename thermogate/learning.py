"""A table of measurements through the daemon's alignment and worker."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from math import ceil, inf
from typing import NamedTuple

from tqdm import tqdm

from adapters.reading import Fault
from service.config.fitting import make_alignment
from service.errors import DataError
from service.records.sample import Sample
from thermogate.frames import Frame, Reader, check_columns, clock, moments
from thermogate.session import Session
from thermogate.settings import ZONE, Settings

SLOW = 2.0
"""Seconds after which a bar shows the progress."""


class Learned(NamedTuple):
    """What was not used of a table: how many readings by the reason, and a sentence about each kind."""

    faults: Counter[Fault]
    warnings: list[str]


class Samples:
    """The samples of a table, on the grid of the zone of `settings`."""

    def __init__(self, settings: Settings, df: Frame, after: int | None = None, idle: int = 0) -> None:
        """Rows up to the sample at `after`, UTC s, are passed over; the last `idle` samples before had no reading.

        DataError for a table that cannot be used, or of which nothing is new.
        """
        period = settings.zone.period
        times = clock(df, settings.tz, "the table")
        check_columns(df, settings.columns, "the table")
        since = -inf if after is None else after + period
        self._reader = Reader(df, times, settings.columns, since)
        self._alignment = make_alignment(settings.zone, after, resume_idle=idle)
        first, last = self._reader.span()
        if last < since:
            newest, until = moments([last, since], settings.tz)
            raise DataError(f"the table ends at {newest}, and the model has learned up to {until}; give later rows")
        self.expected = max(1, ceil((last - max(first, since)) / period))
        """About how many there are."""

    def __iter__(self) -> Iterator[Sample]:
        for part in self._reader.parts():
            yield from self._alignment.add(ZONE, part.readings, part.now)
        yield from self._alignment.end(ZONE)

    def refused(self) -> Learned:
        """What was not used, once the samples have been taken."""
        faults = self._alignment.faults + self._reader.faults
        return Learned(faults, self._reader.refused(faults))


def learn(session: Session, df: Frame, progress: bool, what: str) -> Learned:
    """Take `session` over the rows of `df` that it has not seen; a slow progress is called `what`.

    DataError for a table that cannot be used, or of which nothing is new.
    """
    worker, before = session.worker, len(session)
    samples = Samples(session.settings, df, worker.progress.last_time, worker.empty_samples)
    with tqdm(total=samples.expected, unit=" samples", desc=what, delay=SLOW, disable=not progress) as bar:
        for sample in samples:
            session.take(sample)
            bar.update()
    learned = samples.refused()
    if before == len(session) == 0:
        why = worker.progress.stalled or "there is no reading"
        raise DataError("; ".join([f"no row of the table could be used: {why}", *learned.warnings]))
    return learned
