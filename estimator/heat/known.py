"""The known part f of a network's terms at any time, past or planned, beside the measured inputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.heat.sun import FACES, Location, Sun, clear_sky, split, sun
from estimator.heat.terms import CLEAR, DIFFUSE, HABIT_HOURS, HORIZONTAL, SUN_HOURS, sun_channel
from estimator.network.network import Network

_RESOLUTION = 600.0
"""s: the sun is looked at this often within an interval."""


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


class KnownHeat:
    """Drive rows of one network. It has no state."""

    def __init__(self, network: Network, period: float, calendar: Calendar, location: Location | None = None) -> None:
        """`period` [s] is that over which inputs are held; `location` is needed for the sun by facades and for a
        clear sky."""
        self._network, self._period = network, float(period)
        self._calendar, self._location = calendar, location
        channel = sun_channel(network)
        self._sun = None if channel is None else network.inputs.index(channel)
        self._series = tuple(dict.fromkeys(term.series for term in network.terms))
        self._columns = [self._series.index(term.series) for term in network.terms]
        self._clear = any(name.startswith(CLEAR) for name in self._series)
        parts = max(1, round(period / _RESOLUTION))
        self._parts = (np.arange(parts) + 0.5) * self._period / parts

    def drive(self, times: Array, inputs: Array) -> Array:
        """Rows (L, n_u + m): `inputs` (L, n_u), then f of every term in W per unit of its coefficient.

        `times` (L,) [UTC s] are the beginnings of the intervals over which the inputs are held; f is the mean over the
        interval. Without terms these are the inputs themselves.
        """
        if not self._columns:
            return inputs
        times = np.asarray(times, dtype=np.float64)
        known = {HORIZONTAL: np.maximum(inputs[:, self._sun], 0.0)} if self._sun is not None else {}
        if self._location is not None and (known or self._clear):
            position = sun(times[:, None] + self._parts, self._location)
            known |= _light(position, known[HORIZONTAL]) if known else {}
            if self._clear:
                known |= {CLEAR + name: part for name, part in _light(position, clear_sky(position)).items()}
        local = self._calendar(times + self._period / 2.0)
        habits = _periodic_hats(local.hour)
        for place, hour in enumerate(HABIT_HOURS):
            known[f"habit_{hour:02}"] = habits[:, place]
            known[f"habit_weekend_{hour:02}"] = habits[:, place] * local.off
        if self._sun is not None:
            shares = _hats(local.standard_hour)
            for place, hour in enumerate(SUN_HOURS):
                known[f"sun_{hour:02}"] = shares[:, place] * known[HORIZONTAL]
        return np.column_stack([inputs, *(known[self._series[column]] for column in self._columns)])

    def row(self, time: float, inputs: Array) -> Array:
        """The drive row (n_u + m,) of the interval that begins at `time` [UTC s], under `inputs` (n_u,)."""
        if not self._columns:
            return inputs
        return self.drive(np.array([time]), inputs[None])[0]


def _light(position: Sun, horizontal: Array) -> dict[str, Array]:
    """The mean `horizontal` irradiance (L,) [W/m2], and what of it falls on each face and is diffuse."""
    light = split(position, horizontal)
    return {HORIZONTAL: horizontal, DIFFUSE: light.diffuse} | {face: light.beam[face] for face in FACES}


def _periodic_hats(hours: Array) -> Array:
    """(L, 8): piecewise linear functions of the hour that are 1 at one of HABIT_HOURS, 0 at the others, and add up to
    1."""
    width = HABIT_HOURS[1] - HABIT_HOURS[0]
    apart = np.abs((hours[:, None] - np.array(HABIT_HOURS) + 12.0) % 24.0 - 12.0)
    return np.maximum(1.0 - apart / width, 0.0)


def _hats(hours: Array) -> Array:
    """(L, 5): the same at SUN_HOURS, constant before the first and after the last."""
    place = np.clip(hours, SUN_HOURS[0], SUN_HOURS[-1])
    apart = np.abs(place[:, None] - np.array(SUN_HOURS))
    return np.maximum(1.0 - apart / (SUN_HOURS[1] - SUN_HOURS[0]), 0.0)
