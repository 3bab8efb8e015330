"""A daemon's history as the period of a report: its samples once more through the zones' workers. Published forecasts,
gain, and what the newest checkpoint has are the daemon's own; how parameters and fans of whole days went follows from
its samples, for the same samples and settings give the same bits."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from replay.errors import ReplayError
from replay.localtime import DAY
from replay.recorded.trace import Trace, Tracer, known_by
from service.config.fitting import fingerprint, make_worker
from service.config.site import ZoneConfig
from service.errors import StateMismatch
from service.recordings.progress import Progress
from service.records.history import HistoryRow
from service.records.sample import Sample
from service.records.series import GAIN
from service.store.reading import StoredState, read_state
from service.zone import snapshot

_MOST_ROWS = 2**31


def stored_traces(state_dir: Path, zones: Sequence[ZoneConfig], days: int | None, progress: bool) -> list[Trace]:
    """What the `zones` of the daemon on `state_dir` that have a usable sample went through in all of its journal, or in
    its last `days` days. Raises ReplayError where there is none, and ServiceError where the state cannot be read or
    belongs to another configuration."""
    with read_state(state_dir) as state:
        return traces_of(state, state_dir, zones, days, progress)


def traces_of(
    state: StoredState, place: object, zones: Sequence[ZoneConfig], days: int | None, progress: bool
) -> list[Trace]:
    """As `stored_traces`, of `state` in `place`."""
    traces = []
    marks, starts = state.journal.fingerprints(), {}
    for zone in zones:
        if zone.id in marks:
            if marks[zone.id] != fingerprint(zone):
                raise StateMismatch(zone.id, place)
            starts[zone.id] = _start(state, zone, days)
    total = sum(state.journal.samples_ahead(name, start) for name, start in starts.items())
    with Progress("report", total, progress) as bar:
        for zone in zones:
            if zone.id in starts:
                trace = _trace(state, zone, starts[zone.id], bar.update)
                traces += [trace] if trace.rows else []
    if not traces:
        raise ReplayError(f"there is no usable sample in {place}; a report needs a zone that has had telemetry")
    return traces


def stored_samples(state_dir: Path, zone: ZoneConfig) -> list[Sample]:
    """Every accepted sample of `zone` in `state_dir`, oldest first; ServiceError where they cannot be read.

    Only channels count: the network may have changed as long as it has the same ones in the same order.
    """
    with read_state(state_dir) as state:
        samples = list(state.journal.samples_after(zone.id, None))
    wanted = len(zone.network.measured), len(zone.network.inputs)
    if samples and (len(samples[-1].outputs), len(samples[-1].inputs)) != wanted:
        raise StateMismatch(zone.id, state_dir)
    return samples


def _start(state: StoredState, zone: ZoneConfig, days: int | None) -> int:
    """UTC s after which the samples of `zone` count."""
    last = state.journal.last_sample_time(zone.id)
    return -(2**62) if days is None or last is None else last - days * DAY


def _trace(state: StoredState, zone: ZoneConfig, start: int, tick: Callable[[int], object]) -> Trace:
    worker, checkpoint = make_worker(zone), state.checkpoint(zone.id, fingerprint(zone))
    if checkpoint is not None:
        snapshot.begin(worker, checkpoint)
    tracer = Tracer(zone, worker)
    # All at once: what the daemon deletes meanwhile would be missed in the middle.
    for sample in list(state.journal.samples_after(zone.id, start)):
        update = worker.step(sample)
        if update is not None:
            tracer.note(update)
        tick(1)
    trace = tracer.course({})
    if not trace.rows:
        return trace
    published = {row.time: row for row in state.journal.history(zone.id, trace.rows[0].time, None, _MOST_ROWS)}
    rows = [_kept(published.get(row.time, row), row) for row in trace.rows]
    trace = trace._replace(rows=rows, notes=(_note(trace, published),))
    if checkpoint is not None and not checkpoint.is_beginning:
        worker = make_worker(zone)
        snapshot.restore(worker, checkpoint)
    return known_by(worker, zone, trace)


def _kept(published: HistoryRow, learned: HistoryRow) -> HistoryRow:
    """The row as it was published; one from before gains were kept takes its gain from the row learned anew."""
    if published.gain_median == published.gain_median:
        return published
    return replace(published, **{name: getattr(learned, name) for name in GAIN})


def _note(trace: Trace, published: dict[int, HistoryRow]) -> str:
    """How the samples, taken through a worker once more, compare with what the daemon published."""
    both = [(row.mean, published[row.time].mean) for row in trace.rows if row.time in published]
    ours, theirs = np.array(both).reshape(-1, 2).T
    same = int(((ours == theirs) | (np.isnan(ours) & np.isnan(theirs))).sum())
    if same == len(both) > 0:
        return f"`{trace.zone}`: every forecast that the daemon has published follows from its samples, bit for bit."
    since = f"{trace.moment(trace.rows[0].time)} ({trace.clock})"
    return (
        f"`{trace.zone}`: bands, residuals and gain are those that the daemon published; skill, findings, thermostat "
        "and the answers about the room are those of its newest checkpoint. Parameters and forecasts of whole days "
        f"were learned anew from the samples since {since}, and are not those that the daemon had then ({same} of "
        f"{len(both)} forecasts are the same)."
    )
