"""What people do to a room: they are there, cook, switch on lights and open windows, anew each day from a seed."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.localtime import DAY, HOUR, weekday
from replay.simulated.events import EVERY_DAY, Habit, habitual

_STREAM = 0xE9


class Use(NamedTuple):
    """The habits of a room: people, equipment [W], beside `standby` W, lights [W], windows open [W/K]. In the hours
    `warm` on the weekdays `days` (0 = Monday) the set-point is `by_day` degC, else `by_night`."""

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
