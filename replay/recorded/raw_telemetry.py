"""What a building's logger makes of its sensors: uneven times, noise, resolution, gaps, missing cells, late rows."""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.localtime import HOUR, Seconds, clock_changes

QUIET = 3 * HOUR


class Faults(NamedTuple):
    """What goes wrong: lengths of the gaps in s, how many rows arrive late, and the share of cells that stay empty."""

    gaps: tuple[float, ...]
    late_rows: int
    missing: float


class Sensor(NamedTuple):
    """White noise (sd) and resolution of a sensor, both in its unit."""

    noise_sd: float
    resolution: float


def row_times(start: int, end: int, cadence: tuple[int, int], rng: np.random.Generator) -> Seconds:
    """Ascending UTC seconds in [start, end), apart by whole seconds drawn uniformly from `cadence`."""
    shortest, longest = cadence
    steps = rng.integers(shortest, longest, size=(end - start) // shortest + 1, endpoint=True)
    times = start + np.cumsum(steps) - steps[0]
    return times[times < end]


def measured(sensor: Sensor, times: Seconds, grid: Seconds, values: Array, rng: np.random.Generator) -> Array:
    """Readings at `times` of a temperature given as `values` on `grid`, interpolated linearly."""
    readings = np.interp(times, grid, values) + sensor.noise_sd * rng.standard_normal(len(times))
    return np.round(readings / sensor.resolution) * sensor.resolution


def switched(times: Seconds, grid: Seconds, values: Array) -> Array:
    """Readings at `times` of `values` (K, ...) that hold from each instant of `grid` to the next."""
    return values[np.searchsorted(grid, times, side="right") - 1]


def kept_rows(times: Seconds, faults: Faults, zone: str, rng: np.random.Generator) -> Seconds:
    """Indices of the rows that the logger wrote, in its order. Gaps keep away from both ends, and all faults from clock
    changes, where the order of the rows is all that tells the repeated hour's two halves apart."""
    calm = np.zeros(len(times), dtype=bool)
    for change in clock_changes(times, zone):
        calm |= np.abs(times - change) < QUIET
    kept = np.ones(len(times), dtype=bool)
    for length in faults.gaps:
        while True:
            begin = int(rng.uniform(times[0] + HOUR, times[-1] - length - HOUR))
            lost = (times >= begin) & (times < begin + length)
            if not (lost & calm).any():
                break
        kept &= ~lost
    order = np.flatnonzero(kept)
    for _ in range(faults.late_rows):
        while True:
            place = int(rng.integers(0, len(order) - 8))
            if not calm[order[place : place + 8]].any():
                break
        late = int(rng.integers(1, 7))
        order[place : place + late + 1] = np.roll(order[place : place + late + 1], -1)
    return order


def with_missing(values: Array, share: float, rng: np.random.Generator) -> Array:
    """A copy of `values` (K,) in which a `share` of the cells, chosen at random, is NaN."""
    return np.where(rng.random(len(values)) < share, np.nan, values)


def with_outage(values: Array, times: Seconds, begin: int, length: float) -> Array:
    """A copy of `values` (K,) that is NaN from `begin` on for `length` s: one sensor silent, the others not."""
    return np.where((times >= begin) & (times < begin + length), np.nan, values)
