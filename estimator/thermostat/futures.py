"""Set-points to come where nobody plans them: as now, as yesterday, as a week ago, as usual at this hour.

Where a schedule sets them, they are known, and "as now" means as the schedule of now goes on. Elsewhere nobody knows
what people will set. Each guess becomes a future of its own, and what it proved to be worth decides how
much it counts (`estimator.thermostat.live`).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array, Indices
from estimator.thermostat.memory import Memory, at, slot

Schedule = Callable[[Array], Array]
"""Set-points (h,) [degC] that are known ahead, at times (h,) [UTC s]."""

GUESSES = ("as-now", "as-yesterday", "as-last-week", "as-usual")

KindOfDay = Callable[[Array], Indices]
"""`kinds(times)`: of UTC s (h,), which kind of day each is in, as a number: working day, or weekend and holiday."""


Offsets = Callable[[Array], Array]
"""`offsets(times)`: how far the clocks of the site are ahead of UTC [s] at UTC s (h,), up to whole days."""


def weekday_or_weekend(times: Array) -> Indices:
    """1 on Saturdays and Sundays of UTC, 0 otherwise."""
    # 1970 began on a Thursday.
    return np.asarray((times // DAY + 3) % 7 >= 5, dtype=np.int64)


class ToCome(NamedTuple):
    """What is known of the days and the set-points to come, and of the clocks that people live by."""

    kinds: KindOfDay = weekday_or_weekend
    schedule: Schedule | None = None
    offsets: Offsets = np.zeros_like


NOTHING_KNOWN = ToCome()


def guesses(memory: Memory, now: float, times: Array, known: ToCome = NOTHING_KNOWN) -> Array:
    """(len(GUESSES), h): set-points [degC] of the intervals that begin at `times` (h,) [UTC s], ascending, if they come
    as in each of GUESSES; `now` [degC] where it is not remembered."""
    found = np.full((len(GUESSES), len(times)), now)
    if known.schedule is not None:
        found[0] = known.schedule(times)
    if len(memory.times) and len(times):
        for row, back in ((1, DAY), (2, 7 * DAY)):
            # Beyond its length a period repeats.
            then = times - back * ((times - times[0]) // back + 1.0)
            found[row] = at(memory, memory.setpoints, then + known.offsets(times) - known.offsets(then))
        found[3] = _usual(memory, times, known)
    return np.where(np.isnan(found), now, found)


def _usual(memory: Memory, times: Array, to_come: ToCome) -> Array:
    """(h,): the median of the fortnight's set-points at the same hour of the same kind of day; NaN without any."""
    daily, length, clock = len(memory.times) // 14, slot(memory), to_come.offsets(times[:1])
    rows = memory.setpoints.reshape(14, daily)
    known = np.isfinite(rows)
    when = np.where(known, memory.times.reshape(14, daily), times[0])
    of = np.where(known, to_come.kinds(when.ravel()).reshape(14, daily), -1)
    if to_come.offsets(when.min(keepdims=True).ravel()) != clock:
        # The clocks were changed in this fortnight: each stands where it would by the clocks of now.
        moved = np.rint((to_come.offsets(when.ravel()) - clock) / length).astype(np.int64).reshape(14, daily)
        place = (np.arange(daily) - moved) % daily
        rows, of = (np.take_along_axis(one, place, axis=1) for one in (rows, of))
    place = np.minimum((times + to_come.offsets(times) - clock) % DAY // length, daily - 1).astype(np.int64)
    wanted, usual = to_come.kinds(times), np.full(len(times), np.nan)
    for kind in np.unique(wanted):
        chosen = np.where(of == kind, rows, np.inf)
        count = np.isfinite(chosen).sum(axis=0)
        middle = np.take_along_axis(np.sort(chosen, axis=0), np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
        medians = np.where(count > 0, middle, np.nan)
        usual = np.where(wanted == kind, medians[place], usual)
    return usual
