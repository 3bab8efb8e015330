"""History thinned out in the journal's thread: a year in a thousand points, without a year in memory."""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array, Indices
from service.records.history import HISTORY_COLUMNS
from service.records.series import COLUMNS, Series, Stretch
from service.store.journal import Journal

_INDEX = {name: index for index, name in enumerate(HISTORY_COLUMNS)}
_LOWER, _UPPER, _Y = _INDEX["lower"], _INDEX["upper"], _INDEX["y"]
_MEANS = [_INDEX[name] for name in COLUMNS]


class Buckets(NamedTuple):
    """Partial results by bucket: begin [UTC s] (n,), sums and counts (n, m), lowest and highest (n, k)."""

    times: Indices
    sums: Array
    counts: Array
    low: Array
    high: Array


def bucket_of(start: int, end: int, period: int, points: int) -> int:
    """The shortest bucket [s] of whole periods of which at most `points` cover [start, end)."""
    # The first bucket may begin before the stretch, and the last one end after it.
    return max(1, -(-(end - start) // (period * max(1, points - 1)))) * period


def history_page(journal: Journal, wanted: Stretch, start: int) -> tuple[Buckets, int | None]:
    """The next rows of the history from `start` on, in buckets, and where the page after them begins."""
    times, rows, following = journal.history_columns(wanted.zone, start, wanted.end, wanted.stride * wanted.period)
    return reduced(times, rows[:, _MEANS], rows[:, [_Y, _LOWER]], rows[:, [_Y, _UPPER]], wanted.bucket), following


def inputs_page(journal: Journal, wanted: Stretch, start: int) -> tuple[Buckets, int | None]:
    """The same for the inputs of the accepted samples."""
    step = wanted.stride * wanted.period
    times, inputs, following = journal.input_columns(wanted.zone, start, wanted.end, step, wanted.width)
    return reduced(times, inputs, inputs[:, :0], inputs[:, :0], wanted.bucket), following


def reduced(times: Indices, values: Array, low: Array, high: Array, bucket: int) -> Buckets:
    """Samples at ascending `times` (n,) in buckets: sums and counts of `values` (n, m), extremes of `low` and `high`
    (n, k)."""
    known = np.isfinite(values).astype(np.float64)
    return _together(Buckets(times - times % bucket, np.nan_to_num(values), known, low, high))


def joined(parts: list[Buckets]) -> Buckets:
    """Pages that follow each other, as one; a bucket that two of them share is put together."""
    return _together(Buckets(*(np.concatenate(column) for column in zip(*parts, strict=True))))


def _together(rows: Buckets) -> Buckets:
    """Rows of ascending times, those of one time put together."""
    times, sums, counts, low, high = rows
    first = np.flatnonzero(np.diff(times, prepend=times[:1] - 1))
    if not first.size:
        return rows
    return Buckets(
        times[first],
        np.add.reduceat(sums, first, axis=0),
        np.add.reduceat(counts, first, axis=0),
        np.fmin.reduceat(low, first, axis=0),
        np.fmax.reduceat(high, first, axis=0),
    )


def series_of(history: Buckets, inputs: Buckets, bucket: int) -> Series:
    """The series of what was read. Inputs that were accepted, but not assimilated, have buckets of their own."""
    times = np.union1d(history.times, inputs.times)
    means = _placed(times, history.times, _mean(history))
    low, high = _placed(times, history.times, history.low), _placed(times, history.times, history.high)
    return Series(
        bucket=bucket,
        times=times,
        means=dict(zip(COLUMNS, means.T, strict=True)),
        y_low=low[:, 0],
        y_high=high[:, 0],
        band_low=low[:, 1],
        band_high=high[:, 1],
        inputs=_placed(times, inputs.times, _mean(inputs)),
    )


def _mean(buckets: Buckets) -> Array:
    known = buckets.counts > 0
    return np.where(known, buckets.sums / np.where(known, buckets.counts, 1.0), np.nan)


def _placed(times: Indices, own: Indices, values: Array) -> Array:
    placed = np.full((len(times), values.shape[1]), np.nan)
    placed[np.searchsorted(times, own)] = values
    return placed
