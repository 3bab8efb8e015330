"""Heat that comes and goes: the square waves of paper 4.2 and the irregular gains of a building in use."""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.localtime import DAY, HOUR, Seconds, weekday

WEEKDAYS, WEEKEND = (0, 1, 2, 3, 4), (5, 6)
"""0 = Monday."""
EVERY_DAY = (*WEEKDAYS, *WEEKEND)


class SquareWave(NamedTuple):
    """A flow of `amplitude` W that starts by chance, with `start_probability` per `per` s while it is off, and lasts a
    uniformly drawn time, whole steps between `shortest` and `longest` s."""

    amplitude: float
    start_probability: float
    shortest: float
    longest: float
    per: float = 600.0


HEATER = SquareWave(800.0, 0.02, 20 * 60, 60 * 60)
UNMEASURED_GAIN = SquareWave(7000.0, 0.0055, 20 * 60, 8 * HOUR)


def square_wave(wave: SquareWave, samples: int, period: float, rng: np.random.Generator) -> Array:
    """The flow (samples,) in W on a grid of `period` s, off at first. At least one step long whatever the period."""
    start = 1.0 - (1.0 - wave.start_probability) ** (period / wave.per)
    shortest = max(1, round(wave.shortest / period))
    longest = max(shortest, round(wave.longest / period))
    flow = np.zeros(samples)
    step = int(rng.geometric(start))
    while step < samples:
        end = step + int(rng.integers(shortest, longest, endpoint=True))
        flow[step:end] = wave.amplitude
        step = end + int(rng.geometric(start)) - 1
    return flow


class Habit(NamedTuple):
    """Something people do on `weekdays` (0 = Monday), with probability `likelihood` at all, then a Poisson number of
    times with mean `times_a_day`, beginning anywhere within the local `hours` and ending in them, for a time in s and
    with a strength (W, or W/K for an opening) drawn uniformly from the ranges."""

    weekdays: tuple[int, ...]
    hours: tuple[float, float]
    times_a_day: float
    duration: tuple[float, float]
    strength: tuple[float, float]
    likelihood: float = 1.0


def habitual(habits: tuple[Habit, ...], local: Seconds, rng: np.random.Generator) -> Array:
    """Total strength (K,) of what the `habits` bring at wall-clock seconds `local` (K,)."""
    total = np.zeros(len(local))
    for habit in habits:
        for day in np.unique(local // DAY):
            if int(weekday(day * DAY)) not in habit.weekdays or rng.random() >= habit.likelihood:
                continue
            opens, closes = day * DAY + HOUR * habit.hours[0], day * DAY + HOUR * habit.hours[1]
            for _ in range(int(rng.poisson(habit.times_a_day))):
                begin = rng.uniform(opens, closes)
                end = min(begin + rng.uniform(*habit.duration), closes)
                total[(local >= begin) & (local < end)] += rng.uniform(*habit.strength)
    return total
