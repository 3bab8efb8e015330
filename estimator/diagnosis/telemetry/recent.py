"""The last fortnight of a zone's telemetry, as it was measured.

A sample is kept in the slot of its time, so that memory does not grow with time or with the rate of sampling.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array

DAYS = 14
_SLOT = 600
"""Slots are this long, in s, or as long as a period."""
_SPIKE = 2.0
"""K by which no room warms within a slot."""


class Recent(NamedTuple):
    """m slots of n = 1 + n_u channels: the first output, then the inputs. NaN marks what was not measured."""

    times: Array
    """(m,): beginnings of the slots [UTC s]; NaN for an empty one."""
    counts: Array
    """(n,): measurements in the newest slot."""
    values: Array
    """(m, n): of the output the first, for the rise from one to the next is what a room is known by, or else a spike;
    of every input the mean."""


def nothing_recent(width: int, period: int) -> Recent:
    """Nothing was measured of `width` inputs that are sampled every `period` s."""
    slots = DAYS * (DAY // max(period, _SLOT))
    return Recent(np.full(slots, np.nan), np.zeros(width + 1), np.full((slots, width + 1), np.nan))


def with_measured(recent: Recent, time: int, output: float, inputs: Array) -> Recent:
    """`recent` with the sample at `time` [UTC s]: its first output [degC] and the inputs (n_u,), NaN if missing."""
    length = slot(recent)
    begin = time // length * length
    place = begin // length % len(recent.times)
    times, counts, values = (each.copy() for each in recent)
    if times[place] != begin:
        times[place], values[place], counts = begin, np.nan, np.zeros_like(counts)
    sample = np.concatenate([[output], inputs])
    known = ~np.isnan(sample)
    so_far = np.where(counts > 0.0, values[place], 0.0)
    average = so_far + (sample - so_far) / (counts + 1.0)
    leaps = abs(output - so_far[0]) > _SPIKE
    if counts[0] and not (leaps and abs(output - values[place - 1, 0]) > abs(so_far[0] - values[place - 1, 0])):
        average[0] = so_far[0]
    else:
        average[0] = output
    values[place] = np.where(known, average, values[place])
    return Recent(times, counts + known, values)


def without(recent: Recent, columns: Sequence[int], since: float) -> Recent:
    """`recent` as if nothing of these channels had been measured since `since` [UTC s]."""
    values = recent.values.copy()
    for column in columns:
        values[recent.times >= since, column] = np.nan
    return recent._replace(values=values)


def slot(recent: Recent) -> int:
    """Length of a slot [s]."""
    return DAYS * DAY // len(recent.times)


def begins(recent: Recent, time: float) -> Array:
    """(m,): when the slots of the fortnight that ends with the one before `time` [UTC s] begin, the oldest first."""
    return np.asarray((time // slot(recent) - np.arange(len(recent.times), 0, -1)) * slot(recent))


def until(recent: Recent, time: float) -> Array:
    """(m, n): what was measured in these slots."""
    wanted = begins(recent, time)
    places = (wanted // slot(recent)).astype(np.int64) % len(recent.times)
    rows = recent.values[places].copy()
    rows[recent.times[places] != wanted] = np.nan
    return rows


def inputs_at(recent: Recent, times: Array) -> Array:
    """(h, n_u): the inputs as they were measured at `times` (h,) [UTC s]; NaN where that is not known."""
    begins = times // slot(recent) * slot(recent)
    places = (begins // slot(recent)).astype(np.int64) % len(recent.times)
    return np.where((recent.times[places] == begins)[:, None], recent.values[places, 1:], np.nan)
