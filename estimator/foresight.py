"""Inputs that nobody plans: the weather of the next hours by the shape of the last day, all else held."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.network.presets import NEIGHBOUR

_DAY = 86400
_SLOT = 300
"""Slots of the day are this long, in s, or as long as a period."""

FADES = 9 * 3600.0
"""s in which what a day is warmer than the one before fades to 1/e: with 6 to 12 h, outdoor temperatures of Denver, of
a house and of a test house were foreseen best, and a day ahead with two thirds of the errors that there are without."""

_OLDEST = 2 * _DAY
"""Age in s beyond which a slot tells nothing any more."""


class Day(NamedTuple):
    """The inputs of the last day in m slots of equal length."""

    times: Array
    """(m,): UTC s of what each slot holds; NaN where it holds nothing."""
    inputs: Array
    """(m, n_u)."""
    before: Array
    """(n_u,): what the newest slot held a day before; NaN where it held nothing."""


def no_day(width: int, period: int) -> Day:
    """Nothing is known of `width` inputs that are sampled every `period` s."""
    slots = -(-_DAY // max(period, _SLOT))
    return Day(np.full(slots, np.nan), np.full((slots, width), np.nan), np.full(width, np.nan))


def with_inputs(day: Day, time: int, inputs: Array) -> Day:
    """`day` with the `inputs` (n_u,) of the interval that begins at `time`, UTC s."""
    slot = _slot(day, np.array(time))
    times, rows = day.times.copy(), day.inputs.copy()
    another_day = not time - times[slot] < _DAY // 2
    before = rows[slot].copy() if another_day else day.before
    times[slot], rows[slot] = time, inputs
    return Day(times, rows, before)


class Foreseen(NamedTuple):
    """The inputs of h intervals to come."""

    rows: Array
    """(h, n_u)."""
    by_shape: npt.NDArray[np.bool_]
    """(n_u,): whether an input follows the shape of the last day; otherwise it is held."""


def foreseen(network: Network, day: Day, now: Array, times: Array) -> Foreseen:
    """The inputs of `network` over the intervals that begin at `times` (h,) [UTC s], from those in force `now` (n_u,)
    and the last `day`.

    The shape of the day before is moved so that it begins with the value in force, and goes back to it by FADES: for
    temperatures, whose level changes from day to day, and not for the sun. Where not all of a day is known, the weather
    is held too.
    """
    rows, by_shape = np.tile(now, (len(times), 1)), np.zeros(len(now), dtype=np.bool_)
    for channel, shifted in daily_inputs(network).items() if len(times) else ():
        column = network.inputs.index(channel)
        shape = _by_shape(day, column, now, times, shifted)
        if shape is not None:
            rows[:, column], by_shape[column] = shape, True
    return Foreseen(rows, by_shape)


def _by_shape(day: Day, column: int, now: Array, times: Array, shifted: bool) -> Array | None:
    known = day.times[~np.isnan(day.times)]
    if len(known) < len(day.times) or known.min() < times[0] - _OLDEST or np.isnan(day.before[column]):
        return None
    values: Array = day.inputs[_slot(day, times), column]
    if not shifted:
        return values
    return np.asarray(values + (now[column] - day.before[column]) * np.exp((times[0] - times) / FADES))


def daily_inputs(network: Network) -> dict[str, bool]:
    """The inputs of `network` that follow the weather, and whether their shape is shifted: temperatures around the
    zone other than those of neighbours, and sun."""
    temperatures = {name: True for name in network.boundaries if not name.startswith(NEIGHBOUR)}
    return temperatures | {name: False for name in network.heat_channels if network.channel_unit(name) == "W/m2"}


def _slot(day: Day, times: Array) -> Array:
    length = -(-_DAY // len(day.times))
    return np.asarray(times % _DAY // length, dtype=np.int64)
