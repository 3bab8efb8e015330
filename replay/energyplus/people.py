"""What people do to a room: they are there, cook, switch on lights and open windows, anew each day from a seed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.localtime import DAY, HOUR, weekday
from replay.simulated.events import EVERY_DAY, WEEKDAYS, WEEKEND, Habit, habitual

_STREAM = 0xE9


class Use(NamedTuple):
    """The habits of the people of a room: how many are there, equipment [W], lights [W], windows open [W/K].

    `standby` W of equipment are always on. Between the hours `warm` on the weekdays `days` (0 = Monday) the set-point
    is `by_day` degC, otherwise `by_night`.
    """

    people: tuple[Habit, ...]
    equipment: tuple[Habit, ...]
    lights: tuple[Habit, ...]
    opening: tuple[Habit, ...]
    standby: float
    warm: tuple[float, float]
    days: tuple[int, ...] = EVERY_DAY
    by_day: float = 20.5
    by_night: float = 17.5

    def set_point(self, local: float) -> float:
        """The set-point [degC] at `local`, seconds since 1970-01-01 00:00 by the clock of the place."""
        hour = local % DAY / HOUR
        warm = int(weekday(np.array(local, dtype=np.int64))) in self.days and self.warm[0] <= hour < self.warm[1]
        return self.by_day if warm else self.by_night


class Day(NamedTuple):
    """One day of a room in K steps (K,): people, equipment and lights [W], openings to outdoors [W/K]."""

    people: Array
    equipment: Array
    lights: Array
    opening: Array


class Life:
    """What the people of a building do at any time; a pure function of the time, the uses of its rooms and a seed."""

    def __init__(self, uses: Sequence[Use], step: float, seed: int) -> None:
        self._uses, self._step, self._seed = tuple(uses), step, seed
        self._day = lru_cache(maxsize=2)(self._draw)

    def at(self, local: float) -> Day:
        """People, equipment, lights and openings of every room (N,) in the step at `local` seconds (see `Use`)."""
        drawn = self._day(int(local // DAY))
        row = int(local % DAY / self._step)
        return Day(*(np.array([values[row] for values in field]) for field in zip(*drawn, strict=True)))

    def set_points(self, local: float) -> Array:
        """The set-point [degC] of every room (N,)."""
        return np.array([use.set_point(local) for use in self._uses])

    def _draw(self, day: int) -> tuple[Day, ...]:
        return tuple(draw_day(use, day, self._step, self._seed, room) for room, use in enumerate(self._uses))


def draw_day(use: Use, day: int, step: float, seed: int, room: int) -> Day:
    """Day number `day` since 1970 (local) of room number `room`, every `step` s; the same arguments, the same day."""
    local = day * DAY + np.arange(0, DAY, int(step), dtype=np.int64)
    rng = np.random.default_rng([seed, _STREAM, day, room])
    people = np.round(habitual(use.people, local, rng))
    equipment = use.standby + habitual(use.equipment, local, rng)
    return Day(people, equipment, habitual(use.lights, local, rng), habitual(use.opening, local, rng))


def _at_home(evening: tuple[float, float], weekend: tuple[float, float], persons: tuple[float, float]) -> Use:
    return Use(
        people=(
            Habit(EVERY_DAY, (6.0, 9.0), 1.5, (40 * 60, 2 * HOUR), persons, 0.9),
            Habit(WEEKDAYS, evening, 2.5, (1 * HOUR, 4 * HOUR), persons),
            Habit(WEEKEND, weekend, 3.5, (1 * HOUR, 5 * HOUR), persons, 0.9),
        ),
        equipment=(
            Habit(EVERY_DAY, (11.5, 13.5), 1.0, (20 * 60, 50 * 60), (400.0, 1200.0), 0.4),
            Habit(EVERY_DAY, (17.5, 20.0), 1.2, (20 * 60, 70 * 60), (600.0, 1800.0), 0.8),
            Habit(EVERY_DAY, (18.0, 23.0), 1.5, (1 * HOUR, 3 * HOUR), (80.0, 250.0)),
        ),
        lights=(
            Habit(EVERY_DAY, (6.0, 8.5), 1.0, (40 * 60, 2 * HOUR), (40.0, 120.0), 0.9),
            Habit(EVERY_DAY, (16.5, 23.0), 2.0, (1 * HOUR, 4 * HOUR), (40.0, 150.0)),
        ),
        opening=(
            Habit(EVERY_DAY, (6.5, 9.0), 0.8, (5 * 60, 20 * 60), (60.0, 180.0), 0.7),
            Habit(EVERY_DAY, (17.0, 23.0), 0.8, (5 * 60, 20 * 60), (60.0, 180.0), 0.8),
        ),
        standby=60.0,
        warm=(6.0, 22.0),
    )


KITCHEN_LIVING = _at_home((16.0, 23.0), (9.0, 23.5), (0.6, 2.4))
FAMILY = _at_home((16.0, 23.5), (8.0, 23.5), (0.6, 3.4))
BEDROOMS = Use(
    people=(
        Habit(EVERY_DAY, (0.0, 7.0), 2.0, (4 * HOUR, 7 * HOUR), (0.6, 1.4)),
        Habit(EVERY_DAY, (20.0, 24.0), 1.5, (30 * 60, 3 * HOUR), (0.6, 2.4), 0.8),
    ),
    equipment=(Habit(EVERY_DAY, (17.0, 23.0), 0.8, (30 * 60, 3 * HOUR), (60.0, 250.0), 0.7),),
    lights=(Habit(EVERY_DAY, (19.0, 24.0), 1.2, (30 * 60, 2 * HOUR), (30.0, 90.0)),),
    opening=(
        Habit(EVERY_DAY, (6.5, 9.5), 1.0, (5 * 60, 30 * 60), (40.0, 120.0), 0.8),
        Habit(EVERY_DAY, (20.0, 23.0), 0.4, (5 * 60, 20 * 60), (40.0, 120.0), 0.6),
    ),
    standby=20.0,
    warm=(6.0, 22.0),
    by_day=19.5,
    by_night=17.0,
)
DESK = Use(
    people=(
        Habit(WEEKDAYS, (7.5, 18.0), 3.0, (1 * HOUR, 4 * HOUR), (0.6, 1.4)),
        Habit(WEEKDAYS, (9.0, 17.0), 0.7, (30 * 60, 2 * HOUR), (1.6, 4.4), 0.6),
        Habit(WEEKEND, (9.0, 18.0), 1.0, (1 * HOUR, 3 * HOUR), (0.6, 1.4), 0.2),
    ),
    equipment=(Habit(WEEKDAYS, (7.5, 18.5), 3.0, (1 * HOUR, 5 * HOUR), (60.0, 250.0)),),
    lights=(Habit(WEEKDAYS, (7.0, 18.5), 2.0, (1 * HOUR, 5 * HOUR), (80.0, 200.0)),),
    opening=(Habit(WEEKDAYS, (7.5, 17.5), 1.5, (4 * 60, 20 * 60), (30.0, 100.0), 0.7),),
    standby=40.0,
    warm=(6.0, 18.0),
    days=WEEKDAYS,
    by_day=21.0,
)
HALL = Use(
    people=(Habit(WEEKDAYS, (8.0, 18.0), 3.0, (10 * 60, 40 * 60), (0.6, 2.4)),),
    equipment=(Habit(WEEKDAYS, (8.0, 18.0), 2.0, (5 * 60, 20 * 60), (300.0, 1500.0)),),
    lights=(Habit(WEEKDAYS, (7.0, 18.5), 1.5, (2 * HOUR, 6 * HOUR), (60.0, 120.0)),),
    opening=(Habit(WEEKDAYS, (7.5, 17.5), 1.0, (2 * 60, 10 * 60), (30.0, 90.0), 0.6),),
    standby=30.0,
    warm=(6.0, 18.0),
    days=WEEKDAYS,
    by_day=19.0,
    by_night=16.5,
)
