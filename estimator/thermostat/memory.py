"""The last fortnight of a zone with a set-point: what a thermostat was told, what it saw and what it did.

A sample is remembered in the slot of its time, at most one every SLOT s, so that memory does not grow with time or with
the rate of sampling. A zone that nobody tells a set-point remembers nothing and needs no memory.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from estimator.arrays import DAY, Array, Indices

FORTNIGHT = 14 * DAY
SLOT = 600
"""Slots are this long, in s, or as long as a period."""
_SEEN, _SWINGS = 12, 100
"""Swings from which on there are enough to go by, and how many are told at most."""


class Memory(NamedTuple):
    """m slots of n_u inputs; m is 0 before the first set-point. NaN where a slot holds nothing."""

    times: Array
    """(m,): beginnings of the intervals, UTC s."""
    setpoints: Array
    """(m,): degC."""
    temperatures: Array
    """(m,): first output [degC]."""
    inputs: Array
    """(m, n_u)."""
    before: Array
    """(m, n_u): inputs of the interval before."""


def no_memory(width: int) -> Memory:
    """Nothing is remembered of a zone with `width` inputs."""
    return Memory(np.empty(0), np.empty(0), np.empty(0), np.empty((0, width)), np.empty((0, width)))


def remembered(
    memory: Memory, time: int, period: int, setpoint: float, temperature: float, inputs: Array, before: Array
) -> Memory:
    """`memory` with the sample at `time` [UTC s] that stands for `period` s: set-point and temperature [degC], NaN
    where nobody tells them, the `inputs` (n_u,) in force and those of the sample `before`."""
    if not len(memory.times):
        if np.isnan(setpoint):
            return memory
        slots, width = 14 * (DAY // max(period, SLOT)), len(inputs)
        memory = Memory(*(np.full(slots, np.nan) for _ in range(3)), *(np.full((slots, width), np.nan) for _ in "ib"))
    place, length = int(places(memory, np.array([time]))[0]), slot(memory)
    if time % DAY % length >= period and time - memory.times[place] < length:
        return memory
    after = Memory(*(values.copy() for values in memory))
    after.times[place], after.setpoints[place], after.temperatures[place] = time, setpoint, temperature
    after.inputs[place], after.before[place] = inputs, before
    return after


def slot(memory: Memory) -> int:
    """Length of a slot [s]; of what remembers something."""
    return FORTNIGHT // len(memory.times)


def places(memory: Memory, times: Array) -> Indices:
    """(h,): the slots that hold, or will hold, the `times` (h,) [UTC s]."""
    daily = len(memory.times) // 14
    within = np.minimum(times % DAY // slot(memory), daily - 1)
    return np.asarray(times % FORTNIGHT // DAY * daily + within, dtype=np.int64)


def at(memory: Memory, values: Array, times: Array) -> Array:
    """(h, ...): what `values` (m, ...) of the memory were at `times` (h,) [UTC s]; NaN where that is not remembered."""
    found = places(memory, times)
    known = np.abs(memory.times[found] - times) <= slot(memory)
    rows = values[found].copy()
    rows[~known] = np.nan
    return rows


def setpoints(memory: Memory, times: Array) -> Array:
    """(h,): what the thermostat was set to at `times` (h,) [UTC s]; NaN where that is not remembered."""
    return at(memory, memory.setpoints, times) if len(memory.times) else np.full(len(times), np.nan)


def reaches_back(memory: Memory, time: float) -> bool:
    """Whether something is remembered of a day before `time` [UTC s]."""
    return bool((memory.times <= time - DAY).any())


def in_order(memory: Memory, until: float) -> Memory:
    """The slots of the fortnight before `until` [UTC s], the oldest first."""
    known = np.flatnonzero((memory.times > until - FORTNIGHT) & (memory.times <= until))
    order = known[np.argsort(memory.times[known])]
    return Memory(*(values[order] for values in memory))


def swings(memory: Memory, until: float, span: float) -> Array:
    """(J, n): how far the room was from its mean [K] over a `span` [s] in which the thermostat let it swing, at each
    of its n slots; zeros where that was seen too rarely in the fortnight before `until` [UTC s].

    It swings where the set-point is not above the room throughout, and has been the same in the span before as well.
    """
    length = slot(memory) if len(memory.times) else SLOT
    slots = max(1, round(span / length))
    times, setpoints, temperatures, *_ = in_order(memory, until)
    if len(times) < 2 * slots:
        return np.zeros((1, slots))
    steady = np.ptp(sliding_window_view(setpoints, 2 * slots), axis=1) == 0.0
    steady &= times[2 * slots - 1 :] - times[: 1 - 2 * slots] < (2 * slots - 0.5) * length
    above = sliding_window_view(temperatures - setpoints, 2 * slots)[steady, slots:]
    seen = above[above.min(axis=1, initial=np.inf) <= 0.0]
    if len(seen) < _SEEN:
        return np.zeros((1, slots))
    seen = seen[:: -(-len(seen) // _SWINGS)]
    return np.asarray(seen - seen.mean(axis=1, keepdims=True))
