"""Weather, a table of 52 weeks that begins again, and people's habits, drawn by the week: both out of the seed."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.localtime import DAY, HOUR, midnight, wall_clock
from replay.simulated.events import EVERY_DAY, WEEKDAYS, WEEKEND, Habit, habitual
from replay.simulated.weather import weather

ZONE = "Europe/Berlin"
FIRST_MIDNIGHT = midnight(2025, 1, 13, ZONE)
"""The Monday at whose local midnight the calendar begins, UTC seconds."""

_WEEK = 7 * DAY
_CYCLE = 52 * _WEEK
_WEATHER_STEP = 300
_STEP = 60

_PEOPLE = (
    Habit(WEEKDAYS, (7.5, 18.0), 3.0, (1 * HOUR, 4 * HOUR), (100.0, 400.0)),
    Habit(WEEKDAYS, (8.0, 17.0), 1.0, (30 * 60, 2 * HOUR), (300.0, 900.0), 0.6),
    Habit(WEEKEND, (9.0, 20.0), 1.0, (1 * HOUR, 3 * HOUR), (100.0, 300.0), 0.4),
)
_WINDOWS = (Habit(EVERY_DAY, (7.0, 18.0), 1.5, (4 * 60, 15 * 60), (20.0, 70.0), 0.7),)
_DAY_BEGINS, _DAY_ENDS = 6.0, 19.0
_BY_DAY, _BY_NIGHT = 21.0, 18.0


class Moment(NamedTuple):
    """What acts on the building at one time: degC, W/m2, and per room (N,) W, W/K and set-points in degC."""

    outdoor: float
    irradiance: float
    gain: Array
    opening: Array
    set_point: Array


class Calendar:
    """Weather and habits of `rooms` rooms; `at` is a pure function of the time."""

    def __init__(self, rooms: int, seed: int) -> None:
        self._rooms, self._seed = rooms, seed
        self._sky = weather(np.arange(FIRST_MIDNIGHT, FIRST_MIDNIGHT + _CYCLE, _WEATHER_STEP), seed)
        self._week = lru_cache(maxsize=2)(self._draw_week)

    def at(self, time: float) -> Moment:
        """The moment `time`, in seconds after FIRST_MIDNIGHT."""
        row = int(time % _CYCLE / _WEATHER_STEP)
        gain, opening, set_point = self._week(int(time // _WEEK))
        minute = int(time % _WEEK / _STEP)
        return Moment(
            float(self._sky.outdoor[row]),
            float(self._sky.irradiance[row]),
            gain[minute],
            opening[minute],
            set_point[minute],
        )

    def _draw_week(self, week: int) -> tuple[Array, Array, Array]:
        """Gains, openings and set-points (minutes, rooms) of week number `week`."""
        local = wall_clock(FIRST_MIDNIGHT + week * _WEEK + np.arange(0, _WEEK, _STEP), ZONE)
        rngs = [np.random.default_rng([self._seed, 0xCA1, week, room]) for room in range(self._rooms)]
        gain = np.column_stack([habitual(_PEOPLE, local, rng) for rng in rngs])
        opening = np.column_stack([habitual(_WINDOWS, local, rng) for rng in rngs])
        hour = local % DAY / HOUR
        schedule = np.where((hour >= _DAY_BEGINS) & (hour < _DAY_ENDS), _BY_DAY, _BY_NIGHT)
        # Rooms differ a little, so that there is a flow of heat between them.
        return gain, opening, schedule[:, None] + 0.5 * (np.arange(self._rooms) % 3 - 1)
