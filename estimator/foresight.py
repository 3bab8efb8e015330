"""Inputs that nobody plans: the weather of the next hours as usual at that hour, moved by how it is now; all else held.

Usual is a mean of the last days, hour by hour, in which a day counts less the older it is. On weather of Denver,
Chicago, Washington and Lyngby, and beside three of the measured rooms, it foresees the sun with two thirds of the
errors that the day before alone makes.

How far off that will be is a part of what is foreseen. What is not usual now fades, so what comes strays from what is
foreseen as an Ornstein-Uhlenbeck process does that begins at nought: with sd s it has the variance
s^2 (1 - exp(-2 t / fade)) after t. Each s follows from what a foresight of a day before would have been off by.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import DAY, HOUR, Array, Indices
from estimator.heat.terms import CLEAR, HABIT, sun_channel
from estimator.kernels.draws import Draws, Purpose
from estimator.network.network import Network
from estimator.network.presets import NEIGHBOUR

_SLOT = 300
"""Slots of the day are this long, in s, or as long as a period."""

_NEWEST = 0.2
"""What the newest day counts in what is usual, once as many are known."""

FADES = 24 * 3600.0
"""s in which what a temperature now differs from the usual one fades to 1/e."""

SUN_FADES = 8 * 3600.0
"""The same of the sun, of which the share of the usual one fades to 1."""

NEIGHBOUR_FADES = 7 * 24 * 3600.0
"""The same of a room next door, which has its own shape of the day and else stays as it is."""

_RECENT = 2 * 3600.0
"""s over which the sun of now is seen: a cloud of minutes says little of the hours to come."""

_LITTLE_SUN = 20.0
"""W/m2: that of a dark hour says nothing of a day."""

_BRIGHTEST = 3.0
"""Times the usual sun, at most."""

_OLDEST = 2 * DAY
"""Age in s beyond which a slot tells nothing any more."""

_REMEMBERED, _SUPPOSED = 14.0, 2.0
"""Days over which errors of the foresight are averaged, and what is supposed beforehand counts."""

_OUTDOORS_SD, _NEIGHBOUR_SD, _SUN_SD = 4.0, 1.5, 0.4
"""What is supposed of how inputs stray: K, K, and share of the usual sun."""

FUTURES = 61
"""Ways in which what is foreseen may stray, the same for all rooms of a site at one time."""


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
    strayed: Array
    """(m, n_u): how far `recent` was from `expected` when the newest of each slot came; NaN where nobody knew what is
    usual."""
    moments: Array
    """(3, n_u): means of the squares of that, of its products with that of the day before, and of squares of what is
    usual."""
    verified: Array
    """(): of how many slots, at most those of _REMEMBERED days, `moments` are means."""


def no_day(width: int, period: int) -> Day:
    """Nothing is known of `width` inputs that are sampled every `period` s."""
    slots = -(-DAY // max(period, _SLOT))
    nothing, none = np.full(width, np.nan), np.zeros(width)
    rows = np.full((slots, width), np.nan)
    return Day(
        np.full(slots, np.nan), rows, nothing, np.zeros(slots), none, none, rows, np.zeros((3, width)), np.array(0.0)
    )


def restored(arrays: Mapping[str, Array]) -> Day:
    """The day that was stored as `arrays`, by name; what knew a single day knows the usual one by that, and errors of
    which nothing was stored are supposed anew."""
    width, known = len(arrays["before"]), ~np.isnan(arrays["times"])
    fresh = no_day(width, DAY // len(known))._asdict() | {"days": known.astype(np.float64)}
    return Day(**{**fresh, **arrays})


def with_inputs(day: Day, time: int, inputs: Array) -> Day:
    """`day` with the `inputs` (n_u,) of the interval that begins at `time`, UTC s. The first one of a day that falls
    into a slot stands for it."""
    slot = _slot(day, np.array(time))
    since = time - day.times
    times, rows, days, before = day.times.copy(), day.inputs.copy(), day.days.copy(), day.before
    anew = not since[slot] < DAY // 2
    if anew:
        before = rows[slot].copy()
        days[slot] = days[slot] + 1.0 if since[slot] < _OLDEST else 1.0
        rows[slot] = inputs if days[slot] == 1.0 else before + max(_NEWEST, 1.0 / days[slot]) * (inputs - before)
    times[slot] = time
    passed = since[~np.isnan(since)].min(initial=np.inf)
    # A clock that was set back begins anew.
    share = 1.0 - np.exp(-passed / _RECENT) if passed > 0.0 else 1.0
    usual = np.where(np.isnan(before), inputs, before)
    recent, expected = day.recent + share * (inputs - day.recent), day.expected + share * (usual - day.expected)
    after = day._replace(times=times, inputs=rows, before=before, days=days, recent=recent, expected=expected)
    return _verified(after, int(slot)) if anew else after


def _verified(day: Day, slot: int) -> Day:
    """`day` with what its newest sample, which began `slot` anew, says of the errors that foresight makes."""
    strayed, then = day.strayed.copy(), day.strayed[slot]
    now = strayed[slot] = np.where(np.isnan(day.before) | (day.days[slot] < 2.0), np.nan, day.recent - day.expected)
    told = np.array([now * now, now * then, day.expected**2])
    if np.isnan(told).any():
        return day._replace(strayed=strayed)
    verified = np.minimum(day.verified + 1.0, _REMEMBERED * len(day.times))
    return day._replace(
        strayed=strayed, moments=day.moments + (told - day.moments) / verified, verified=np.array(verified)
    )


class Foreseen(NamedTuple):
    """The inputs of h intervals to come."""

    rows: Array
    """(h, n_u)."""
    by_shape: npt.NDArray[np.bool_]
    """(n_u,): whether an input follows the shape of the usual day; otherwise it is held."""


def foreseen(network: Network, day: Day, now: Array, times: Array) -> Foreseen:
    """The inputs of `network` over the intervals that begin at `times` (h,) [UTC s], from those in force `now` (n_u,)
    and the usual `day`.

    A temperature, and the cover of clouds, begins with the value in force and goes over to the usual one as it fades;
    the sun begins with the share of the usual one that it had lately. Where not all of a day is known, all is held.
    """
    rows, by_shape = np.tile(now, (len(times), 1)), np.zeros(len(now), dtype=np.bool_)
    known = day.times[~np.isnan(day.times)]
    if not len(times) or len(known) < len(day.times) or known.min() < times[0] - _OLDEST:
        return Foreseen(rows, by_shape)
    for column, fades, is_sun in _daily(network):
        if np.isnan(day.before[column]):
            continue
        usual, by_shape[column] = day.inputs[_slot(day, times), column], True
        left = np.exp((times[0] - times) / fades)
        if is_sun:
            share = (day.recent[column] + _LITTLE_SUN) / (day.expected[column] + _LITTLE_SUN)
            rows[:, column] = usual * (1.0 + (min(max(share, 0.0), _BRIGHTEST) - 1.0) * left)
        else:
            rows[:, column] = usual + (now[column] - day.before[column]) * left
            if network.inputs[column] == network.clouds:
                rows[:, column] = np.clip(rows[:, column], 0.0, 100.0)
    return Foreseen(rows, by_shape)


def strays(network: Network, day: Day) -> Array:
    """(n_u,): the sd with which each input of `network` strays in the end from what is foreseen: K of a temperature,
    share of the sun, for clouds of the sun that they dim; 0 for what has no shape of the day."""
    found = np.zeros(len(network.inputs))
    squares, products, usual = day.moments
    days = float(day.verified) / len(day.times)
    for column, fades, is_sun in _daily(network):
        left = 0.0 if is_sun else float(np.exp(-DAY / fades))
        # A foresight of a day before was off by what is unusual now, less what was left of what was unusual then.
        error = (1.0 + left**2) * squares[column] - 2.0 * left * products[column]
        told = error / max(float(usual[column]), _LITTLE_SUN) if is_sun else error / (1.0 - left**2)
        if network.inputs[column] == network.clouds:
            # On the mean of all covers, a percent more of them leaves about one less of the sun.
            told, is_sun = told / 100.0**2, True
        supposed = _SUN_SD if is_sun else _NEIGHBOUR_SD if fades == NEIGHBOUR_FADES else _OUTDOORS_SD
        found[column] = np.sqrt((days * max(told, 0.0) + _SUPPOSED * supposed**2) / (days + _SUPPOSED))
    return found


class Astray(NamedTuple):
    """How K futures of h steps differ from what is foreseen."""

    weather: Indices
    """(K,): numbers below FUTURES; who has the same one has the same weather."""
    shifts: tuple[tuple[int, Array], ...]
    """Columns of a drive row, and what is added to each (K, h) [K]."""
    sunny: Indices
    """Columns of a drive row that are sun."""
    sun: Array
    """(K, h): by which they are multiplied, less 1."""


class Weather(NamedTuple):
    """FUTURES futures of h steps, in which what is foreseen strays. Rooms that are asked at one time share them."""

    shifts: tuple[tuple[int, Array], ...]
    """Columns of a drive row, and what is added to each (h, FUTURES) [K]."""
    sun: Array
    """(h, FUTURES): by which the sun is multiplied, less 1."""

    def chosen(self, network: Network, numbers: Indices) -> Astray:
        """The futures with these `numbers` (K,), of any size, for models of `network`."""
        own = numbers % FUTURES
        shifts = tuple((column, shift[:, own].T) for column, shift in self.shifts)
        return Astray(own, shifts, _sunny(network), self.sun[:, own].T)


def weather(network: Network, sds: Array, period: float, steps: int, time: int) -> Weather:
    """The futures of the inputs of `network` that stray by `sds` (n_u,) over `steps` of `period` s from `time` [UTC s]
    on."""
    hours, daily = -(-round(steps * period) // HOUR), _daily(network)
    draws = Draws(0, int(time // HOUR), forecast=True)
    normals = draws.normals(Purpose.FORESEEN, (len(daily) * hours, FUTURES)).reshape(len(daily), hours, FUTURES)
    normals = normals - normals.mean(axis=2, keepdims=True)
    hour = (np.arange(steps) * period // HOUR).astype(np.int64)
    shifts, sun = [], np.zeros((steps, FUTURES))
    for (column, fades, is_sun), own in zip(daily, normals, strict=True):
        if sds[column] <= 0.0:
            continue
        left = float(np.exp(-HOUR / fades))
        paths = np.sqrt(1.0 - left**2) * own
        for place in range(1, hours):
            paths[place] += left * paths[place - 1]
        if is_sun or network.inputs[column] == network.clouds:
            share = np.maximum(1.0 + sds[column] * paths, 0.0)
            # What is cut off below nought must not make it brighter on the whole.
            sun = (share / share.mean(axis=1, keepdims=True) - 1.0)[hour]
        else:
            shifts.append((column, sds[column] * paths[hour]))
    return Weather(tuple(shifts), sun)


def _daily(network: Network) -> list[tuple[int, float, bool]]:
    """The inputs of `network` that have a shape of the day: temperatures around the zone, clouds, and the sun. Their
    columns, the s in which what is unusual fades, and whether they are the sun."""
    found = [
        (place, NEIGHBOUR_FADES if name.startswith(NEIGHBOUR) else FADES, False)
        for place, name in enumerate(network.boundaries)
    ]
    suns = [name for name in network.heat_channels if network.channel_unit(name) == "W/m2"]
    clouds = [] if network.clouds is None else [network.clouds]
    return found + [(network.inputs.index(name), SUN_FADES, name in suns) for name in (*suns, *clouds)]


def _sunny(network: Network) -> Indices:
    """The columns of a drive row that are in proportion to the sun."""
    first = len(network.inputs)
    channel = sun_channel(network)
    terms = [
        first + place
        for place, term in enumerate(network.terms)
        if not term.series.startswith(HABIT) and (network.clouds is not None or not term.series.startswith(CLEAR))
    ]
    return np.array([*([] if channel is None else [network.inputs.index(channel)]), *terms], dtype=np.int64)


def _slot(day: Day, times: Array) -> Array:
    length = -(-DAY // len(day.times))
    return np.asarray(times % DAY // length, dtype=np.int64)
