"""A table of measurements through the daemon's alignment and worker."""

from collections import Counter
from math import inf
from typing import NamedTuple

from adapters.reading import Fault
from service.config.fitting import make_alignment
from service.errors import DataError
from service.recordings.doubts import Remedies, doubts
from service.recordings.progress import Progress
from service.recordings.samples import Recorded
from service.records.outlook import SET_POINTS
from service.records.sample import Sample
from service.zone.alignment import SETPOINT
from thermogate.frames import Frame, Reader, check_columns, clock, moments
from thermogate.session import Session
from thermogate.settings import ZONE, Settings


def _with_unit(channel: str, unit: str) -> str:
    name = SET_POINTS if channel == SETPOINT else channel
    return f'columns={{"{name}": ("{name}", "{unit}")}}, with the name of its column'


_REMEDIES = Remedies(_with_unit, "pd.to_datetime(df.index, dayfirst=True)", 'tz="Europe/Berlin"')


class Taken(NamedTuple):
    """The samples of a table on the grid of a zone, how many readings were refused by the reason, and one sentence for
    each thing that was not used or looks wrong."""

    samples: list[Sample]
    faults: Counter[Fault]
    warnings: list[str]


def taken(settings: Settings, df: Frame, after: int | None = None, idle: int = 0) -> Taken:
    """What the table `df` holds of the zone of `settings` after the sample at `after`, UTC s; the last `idle` samples
    before had no reading. DataError for a table that cannot be used, or of which nothing is new."""
    times = clock(df, settings.tz, "the table")
    check_columns(df, settings.columns, "the table")
    since = -inf if after is None else after + settings.zone.period
    reader = Reader(df, times, settings.columns, since)
    alignment = make_alignment(settings.zone, after, resume_idle=idle)
    last = reader.last()
    if last < since:
        newest, until = moments([last, since], settings.tz)
        raise DataError(f"the table ends at {newest}, and the model has learned up to {until}; give later rows")
    samples: list[Sample] = []
    for part in reader.parts():
        samples += alignment.add(ZONE, part.readings, part.now)
    samples += alignment.end(ZONE)
    faults = alignment.faults + reader.faults
    sentences = reader.refused(faults)
    if after is None:
        # What is refused has its sentences already, column by column.
        found = Recorded(samples, {}, 0)
        sentences += [f"the table: {sentence}" for sentence in doubts(settings.zone, found, _REMEDIES)]
    return Taken(samples, faults, sentences)


def learn(session: Session, df: Frame, progress: bool, what: str) -> Taken:
    """Take `session` over the rows of `df` that it has not seen; a slow progress is called `what`.

    DataError for a table that cannot be used, or of which nothing is new.
    """
    worker, before = session.worker, len(session)
    found = taken(session.settings, df, worker.progress.last_time, worker.empty_samples)
    if found.samples:
        worker.loop.history_end = found.samples[-1].time
    with Progress(what, len(found.samples), progress) as bar:
        for sample in found.samples:
            session.take(sample)
            bar.update()
    if before == len(session) == 0:
        why = worker.progress.stalled or "there is no reading"
        raise DataError("; ".join([f"no row of the table could be used: {why}", *found.warnings]))
    return found
