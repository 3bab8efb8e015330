"""A table of measurements through the daemon's alignment and worker."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from math import ceil, inf
from typing import Any, NamedTuple

from tqdm import tqdm

from adapters.reading import Fault
from service.config.fitting import make_alignment
from service.errors import DataError
from service.records.sample import Sample
from thermogate.frames import Frame, Reader, check_columns, clock, moments
from thermogate.session import Session
from thermogate.settings import ZONE

_SLOW = 2.0
"""Seconds after which a bar shows the progress."""


class Learned(NamedTuple):
    """What was not used of a table: how many readings by the reason, and a sentence about each kind."""

    faults: Counter[Fault]
    warnings: list[str]


def learn(session: Session, df: Frame, progress: bool, what: str) -> Learned:
    """Take `session` over the rows of `df` that it has not seen; a slow progress is called `what`.

    DataError for a table that cannot be used, or of which nothing is new.
    """
    settings, worker = session.settings, session.worker
    period, resume_after, before = settings.zone.period, worker.progress.last_time, len(session)
    times = clock(df, settings.tz, "the table")
    check_columns(df, settings.columns, "the table")
    since = -inf if resume_after is None else resume_after + period
    reader = Reader(df, times, settings.columns, since)
    alignment = make_alignment(settings.zone, resume_after, resume_idle=worker.empty_samples)
    first, last = reader.span()
    if last < since:
        newest, until = moments([last, since], settings.tz)
        raise DataError(f"the table ends at {newest}, and the model has learned up to {until}; give later rows")
    total = max(1, ceil((last - max(first, since)) / period))
    with tqdm(total=total, unit=" samples", desc=what, delay=_SLOW, disable=not progress) as bar:
        for part in reader.parts():
            _take(session, alignment.add(ZONE, part.readings, part.now), bar)
        _take(session, alignment.end(ZONE), bar)
    faults = alignment.faults + reader.faults
    sentences = reader.refused(faults)
    if before == len(session) == 0:
        why = worker.progress.stalled or "there is no reading"
        raise DataError("; ".join([f"no row of the table could be used: {why}", *sentences]))
    return Learned(faults, sentences)


def _take(session: Session, samples: Iterable[Sample], bar: Any) -> None:
    for sample in samples:
        session.take(sample)
        bar.update()
