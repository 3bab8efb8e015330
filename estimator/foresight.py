"""Inputs that nobody plans: the weather of the next hours as usual at that hour, moved by how it is now; all else held.

Usual is a mean of the last days, hour by hour, in which a day counts less the older it is. On weather of Denver,
Chicago, Washington and Lyngby, and beside three of the measured rooms, it foresees the sun with two thirds of the
errors that the day before alone makes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.network.presets import NEIGHBOUR

_DAY = 86400
_SLOT = 300
"""Slots of the day are this long, in s, or as long as a period."""

_NEWEST = 0.2
"""What the newest day counts in what is usual, once as many are known."""

FADES = 24 * 3600.0
"""s in which what a temperature now differs from the usual one fades to 1/e."""

SUN_FADES = 8 * 3600.0
"""The same of the sun, of which the share of the usual one fades to 1."""

_RECENT = 2 * 3600.0
"""s over which the sun of now is seen: a cloud of minutes says little of the hours to come."""

_LITTLE_SUN = 20.0
"""W/m2: that of a dark hour says nothing of a day."""

_BRIGHTEST = 3.0
"""Times the usual sun, at most."""

_OLDEST = 2 * _DAY
"""Age in s beyond which a slot tells nothing any more."""


class Day(NamedTuple):
    """The usual day in m slots of equal length."""

    times: Array
    """(m,): UTC s of the newest of what each slot knows; NaN where it knows nothing."""
    inputs: Array
    """(m, n_u): what is usual there."""
    before: Array
    """(n_u,): what was usual in the newest slot before it came; NaN where it knew nothing."""
    days: Array
    """(m,): of how many days each slot is the mean."""
    recent: Array
    """(n_u,): means of what came in the last hours."""
    expected: Array
    """(n_u,): the same of what would have been usual."""


def no_day(width: int, period: int) -> Day:
    """Nothing is known of `width` inputs that are sampled every `period` s."""
    slots = -(-_DAY // max(period, _SLOT))
    nothing, none = np.full(width, np.nan), np.zeros(width)
    return Day(np.full(slots, np.nan), np.full((slots, width), np.nan), nothing, np.zeros(slots), none, none)


def restored(arrays: Mapping[str, Array]) -> Day:
    """The day that was stored as `arrays`, by name; what knew a single day knows the usual one by that."""
    known, width = ~np.isnan(arrays["times"]), len(arrays["before"])
    fresh = {"days": known.astype(np.float64), "recent": np.zeros(width), "expected": np.zeros(width)}
    return Day(**{**fresh, **arrays})


def with_inputs(day: Day, time: int, inputs: Array) -> Day:
    """`day` with the `inputs` (n_u,) of the interval that begins at `time`, UTC s. The first one of a day that falls
    into a slot stands for it."""
    slot = _slot(day, np.array(time))
    since = time - day.times
    times, rows, days, before = day.times.copy(), day.inputs.copy(), day.days.copy(), day.before
    if not since[slot] < _DAY // 2:
        before = rows[slot].copy()
        days[slot] = days[slot] + 1.0 if since[slot] < _OLDEST else 1.0
        rows[slot] = inputs if days[slot] == 1.0 else before + max(_NEWEST, 1.0 / days[slot]) * (inputs - before)
    times[slot] = time
    passed = since[~np.isnan(since)].min(initial=np.inf)
    # A clock that was set back begins anew.
    share = 1.0 - np.exp(-passed / _RECENT) if passed > 0.0 else 1.0
    usual = np.where(np.isnan(before), inputs, before)
    recent = day.recent + share * (inputs - day.recent)
    return Day(times, rows, before, days, recent, day.expected + share * (usual - day.expected))


class Foreseen(NamedTuple):
    """The inputs of h intervals to come."""

    rows: Array
    """(h, n_u)."""
    by_shape: npt.NDArray[np.bool_]
    """(n_u,): whether an input follows the shape of the usual day; otherwise it is held."""


def foreseen(network: Network, day: Day, now: Array, times: Array) -> Foreseen:
    """The inputs of `network` over the intervals that begin at `times` (h,) [UTC s], from those in force `now` (n_u,)
    and the usual `day`.

    A temperature begins with the value in force and goes over to the usual one by FADES; the sun begins with the share
    of the usual one that it had lately. Where not all of a day is known, the weather is held too.
    """
    rows, by_shape = np.tile(now, (len(times), 1)), np.zeros(len(now), dtype=np.bool_)
    known = day.times[~np.isnan(day.times)]
    if not len(times) or len(known) < len(day.times) or known.min() < times[0] - _OLDEST:
        return Foreseen(rows, by_shape)
    for channel, shifted in daily_inputs(network).items():
        column = network.inputs.index(channel)
        if np.isnan(day.before[column]):
            continue
        usual, by_shape[column] = day.inputs[_slot(day, times), column], True
        if shifted:
            rows[:, column] = usual + (now[column] - day.before[column]) * np.exp((times[0] - times) / FADES)
        else:
            share = (day.recent[column] + _LITTLE_SUN) / (day.expected[column] + _LITTLE_SUN)
            more = min(max(share, 0.0), _BRIGHTEST) - 1.0
            rows[:, column] = usual * (1.0 + more * np.exp((times[0] - times) / SUN_FADES))
    return Foreseen(rows, by_shape)


def daily_inputs(network: Network) -> dict[str, bool]:
    """The inputs of `network` that follow the weather, and whether their shape is shifted: temperatures around the
    zone other than those of neighbours, and sun."""
    temperatures = {name: True for name in network.boundaries if not name.startswith(NEIGHBOUR)}
    return temperatures | {name: False for name in network.heat_channels if network.channel_unit(name) == "W/m2"}


def _slot(day: Day, times: Array) -> Array:
    length = -(-_DAY // len(day.times))
    return np.asarray(times % _DAY // length, dtype=np.int64)
