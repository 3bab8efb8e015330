"""The known part f of a network's terms at any time, past or planned, beside the measured inputs."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array, Indices
from estimator.heat.sun import FACES, Geometry, Location, clear_sky, geometry, split, sun, through_clouds
from estimator.heat.terms import CLEAR, DIFFUSE, HABIT, HABIT_HOURS, HORIZONTAL, SUN_HOURS, sun_channel
from estimator.network.network import Network

_RESOLUTION = 600.0
"""s: the sun is looked at this often within an interval."""

_DAYS_KEPT = 2
"""Days of which what depends on the time alone is kept: a sample needs one, a forecast of a day two."""
_SHORTEST = 60.0
"""s: with shorter periods a day is too many intervals to keep, and to compute for one sample."""


class LocalTime(NamedTuple):
    """Local time at L times."""

    hour: Array
    """(L,): h of the day, as clocks show it."""
    standard_hour: Array
    """(L,): the same without daylight saving time."""
    off: Array
    """(L,): 1 on weekends and public holidays, else 0."""


Calendar = Callable[[Array], LocalTime]
"""Local time at times [UTC s]."""


class _Timely(NamedTuple):
    """What depends on the time alone, of L intervals."""

    light: Geometry
    alone: Array
    """(L, 22): series that depend on nothing else, by _ALONE."""
    shares: Array
    """(L, 5): by SUN_HOURS."""


_LIGHT = (HORIZONTAL, DIFFUSE, *FACES)
_ALONE = (
    *(f"{HABIT}{hour:02}" for hour in HABIT_HOURS),
    *(f"{HABIT}weekend_{hour:02}" for hour in HABIT_HOURS),
    *(CLEAR + name for name in _LIGHT),
)
_OF_SUN = (*_LIGHT, *(f"sun_{hour:02}" for hour in SUN_HOURS))
"""Series, in the order of columns."""


class KnownHeat:
    """Drive rows of one network. It has no state."""

    def __init__(self, network: Network, period: float, calendar: Calendar, location: Location | None = None) -> None:
        """`period` [s] is that over which inputs are held; `location` is needed for the sun by facades and for a
        clear sky."""
        self._network, self._period = network, float(period)
        self._calendar, self._location = calendar, location
        channel = sun_channel(network)
        self._sun = None if channel is None else network.inputs.index(channel)
        self._clouds = None if network.clouds is None else network.inputs.index(network.clouds)
        known = (*network.inputs, *_ALONE, *(() if self._sun is None else _OF_SUN))
        self._columns = np.array(
            [known.index(name) for name in (*network.inputs, *(term.series for term in network.terms))], dtype=np.int64
        )
        parts = max(1, round(period / _RESOLUTION))
        self._parts = (np.arange(parts) + 0.5) * self._period / parts
        self._of_day = lru_cache(_DAYS_KEPT)(self._computed_of_day)

    def drive(self, times: Array, inputs: Array) -> Array:
        """Rows (L, n_u + m): `inputs` (L, n_u), then f of every term in W per unit of its coefficient.

        `times` (L,) [UTC s] are the beginnings of the intervals over which the inputs are held; f is the mean over the
        interval. Without terms these are the inputs themselves. What a clear sky would give is less under clouds.
        """
        if not self._network.terms:
            return inputs
        timely = self._timely(np.asarray(times, dtype=np.float64))
        alone = timely.alone
        if self._clouds is not None:
            habits, clear = alone[:, : -len(_LIGHT)], alone[:, -len(_LIGHT)]
            dimmed = _light(timely.light, clear * through_clouds(inputs[:, self._clouds]))
            alone = np.concatenate([habits, dimmed], axis=1)
        known = [inputs, alone]
        if self._sun is not None:
            horizontal = np.maximum(inputs[:, self._sun], 0.0)
            known += [_light(timely.light, horizontal), timely.shares * horizontal[:, None]]
        return np.concatenate(known, axis=1).take(self._columns, axis=1)

    def _timely(self, times: Array) -> _Timely:
        """What depends on `times` (L,) alone; computed for a day at once where they lie on the grid of the period, in
        no more days than are kept."""
        if self._period < _SHORTEST or DAY % self._period or not len(times) or (times % self._period).any():
            return self._computed(times)
        first, last = int(times.min()) // DAY, int(times.max()) // DAY
        if last - first >= _DAYS_KEPT:
            return self._computed(times)
        places = ((times - first * DAY) / self._period).astype(np.int64)
        return _at(_joined([self._of_day(day) for day in range(first, last + 1)]), places)

    def _computed_of_day(self, day: int) -> _Timely:
        """Of all intervals of the `day`, counted from 1970 in UTC."""
        return self._computed(day * float(DAY) + np.arange(0.0, DAY, self._period))

    def _computed(self, times: Array) -> _Timely:
        local = self._calendar(times + self._period / 2.0)
        # Where nobody knows the location, nothing asks for the light.
        position = sun(times[:, None] + self._parts, self._location or Location(0.0, 0.0))
        light, habits = geometry(position), _periodic_hats(local.hour)
        alone = [habits, habits * local.off[:, None], _light(light, clear_sky(position))]
        return _Timely(light, np.concatenate(alone, axis=1), _hats(local.standard_hour))


def _at(timely: _Timely, places: Indices) -> _Timely:
    light, *others = timely
    return _Timely(Geometry(*(rows[places] for rows in light)), *(rows[places] for rows in others))


def _joined(each: Sequence[_Timely]) -> _Timely:
    if len(each) == 1:
        return each[0]
    lights, *others = zip(*each, strict=True)
    joined = Geometry(*(np.concatenate(rows) for rows in zip(*lights, strict=True)))
    return _Timely(joined, *(np.concatenate(rows) for rows in others))


def _light(over: Geometry, horizontal: Array) -> Array:
    """(L, 6): by _LIGHT, the mean `horizontal` irradiance (L,) [W/m2], what of it is diffuse, and what falls on each
    face."""
    light = split(over, horizontal)
    return np.concatenate([horizontal[:, None], light.diffuse[:, None], light.beam], axis=1)


def _periodic_hats(hours: Array) -> Array:
    """(L, 8): piecewise linear functions of the hour that are 1 at one of HABIT_HOURS, 0 at the others, and add up to
    1."""
    width = HABIT_HOURS[1] - HABIT_HOURS[0]
    apart = np.abs((hours[:, None] - np.array(HABIT_HOURS) + 12.0) % 24.0 - 12.0)
    return np.maximum(1.0 - apart / width, 0.0)


def _hats(hours: Array) -> Array:
    """(L, 5): the same at SUN_HOURS, constant before the first and after the last."""
    apart = np.abs(np.clip(hours, SUN_HOURS[0], SUN_HOURS[-1])[:, None] - np.array(SUN_HOURS))
    return np.maximum(1.0 - apart / (SUN_HOURS[1] - SUN_HOURS[0]), 0.0)
