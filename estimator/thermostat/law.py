"""The law of a thermostat, learned from the last fortnight.

With x = T_set - T_i for a heater, and T_i - T_set for a cooler, and the heat q >= 0 that it gives or takes,

    proportional:  q = P clip((x - m) / w + 1/2, 0, 1)
    on-off:        q = P above m + w/2, 0 below m - w/2, as before in between.

The first is u = clip(a + b x, 0, P) with b = P / w and a = P/2 - b m. P is the power [W], m the offset [K] and w the
band, or the hysteresis [K]. All are fitted by least squares, the kind is the one with the smaller squares, and what is
uncertain follows from leaving out one day after the other (the jackknife of days, held to its median: errors of one day
are alike).

A law that knows the heat before has the smaller squares for a valve that is moved by and by as well, at the power that
the valve gives mostly. So a heater is on-off only where it gives all or nothing: where the median of the heat, while
there is any, is next to the most that it gives.

A relay that switches within an interval looks proportional, and the heat of an interval hardly follows the temperature
at its beginning: least squares then take the band for several times as wide, and a simulated room never gets as warm
as it is. So offset and band of a proportional law are seen the other way round, in hourly means, in which a swing
cancels out: how far the room is from its set-point while a share of the power is called for,

    x = m + w (q / P - 1/2),   0 < q < P,

by the medians of x in bins of q / P.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import DAY, Array, Indices
from estimator.network.network import Network
from estimator.thermostat.memory import Memory

_REACH = 4.0
"""K: larger deviations from the set-point count as this one."""

_BIN = 0.05
"""K: width of the bins in which deviations are counted for the proportional law."""

_NARROWEST = 0.05
"""K: the smallest band; a step is no law that a sum of squares can be searched for."""

_HOUR = 3600.0
"""s over which offset and band of a proportional law are seen."""

_SHARES = np.linspace(0.05, 0.95, 10)
"""Edges of the bins of the share of the power."""

_FEWEST = 72
"""Slots with a set-point, a temperature and heat before a law is fitted: half a day of 10 min."""

_ZOOMS, _SIDE = 5, 7
"""Refinements of the grid in which offset and band are searched, and points of each along one of the two."""

_LEAST_EXPLAINED = 0.25
"""Share of the variance of the heat that a law must explain. Below that the heat obeys somebody else."""

_MARGIN = 0.5
"""K beyond its band from which a law calls for all or for nothing without doubt."""

_FARTHEST = 4.5
"""Median deviations beyond which what leaving out one day changes counts as this much: 3 standard deviations."""

LITTLE, MUCH = 0.1, 0.5
"""Shares of its power below which next to nothing came, and above which most of it did."""

_NOTHING, _SELDOM, _FEW = 0.02, 0.05, 20
"""Share of the power of a heater that is off; share of the times that may be shorter than the shortest; and fewest."""

_ALL = 0.9
"""Share of the heat that is given at most (but for a tenth of the slots) from which on all of it is given."""

_SDS = (0.01, 0.02, 0.02)
"""Smallest standard deviations: of the power, relative to it, and of offset and band [K]."""


class Laws(NamedTuple):
    """L laws: of heating and of cooling, by any number of heat inputs."""

    column: Array
    """(L,): the input that obeys."""
    side: Array
    """(L,): 1 where heat is called for when the room is too cold, -1 when it is too warm."""
    sign: Array
    """(L,): sign of the input's values when it is called."""
    switching: Array
    """(L,): 1 on-off, 0 proportional."""
    numbers: Array
    """(L, 3): power [unit of the input], offset [K], band or hysteresis [K]."""
    covariance: Array
    """(L, 3, 3): of `numbers`."""
    explained: Array
    """(L,): share of the variance of the heat that the law explains, one interval ahead."""
    days: Array
    """(L,): days that it was fitted to."""


def no_laws() -> Laws:
    """Nobody obeys a set-point."""
    empty = np.empty(0)
    return Laws(empty, empty, empty, empty, np.empty((0, 3)), np.empty((0, 3, 3)), empty, empty)


def identified(network: Network, memory: Memory) -> Laws:
    """The laws of the heat inputs of `network` that obey the set-point, as far as `memory` shows them."""
    found = []
    deviation = memory.setpoints - memory.temperatures
    days = (memory.times // DAY) if len(memory.times) else memory.times
    for channel in network.heat_channels:
        if network.channel_unit(channel) != "W":
            continue
        column = network.inputs.index(channel)
        direction = -1.0 if _cools(network, channel) else 1.0
        for sign in (1.0, -1.0):
            heat, before = (np.maximum(sign * rows[:, column], 0.0) for rows in (memory.inputs, memory.before))
            known = np.isfinite(deviation) & np.isfinite(heat)
            side = sign * direction
            runs = _runs(memory.times[known], memory.setpoints[known])
            law = _fitted(side * deviation[known], heat[known], before[known], days[known], runs)
            if law is not None:
                found.append((float(column), side, sign, *law))
    if not found:
        return no_laws()
    return Laws(*(np.array(values) for values in zip(*found, strict=True)))


def called(laws: Laws, place: int, now: Array, later: Array, effect: Array, before: Array) -> Array:
    """Heat >= 0 that law `place` gives over an interval, where it gave `before` an interval ago: T_set - T_i [K] is
    `now` at its beginning, and would be `later` at its end without this heat, each unit of which warms by `effect`."""
    numbers, side = laws.numbers[place], laws.side[place]
    if laws.switching[place]:
        return _given(1, numbers, side * now, before)
    power, offset, band = numbers.tolist()
    share = ((side * later - offset) / band + 0.5) / (1.0 + np.maximum(side * effect, 0.0) * power / band)
    return np.asarray(power * np.clip(share, 0.0, 1.0), dtype=np.float64)


def clear(numbers: Array, x: Array, margin: float = _MARGIN) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """(n,), (n,): where a law with `numbers` calls for all of its power without doubt, and where for none."""
    _, offset, band = numbers.tolist()
    return x > offset + 0.5 * band + margin, x < offset - 0.5 * band - margin


def shortest_times(laws: Laws, place: int, memory: Memory, period: float) -> tuple[float, float]:
    """The shortest times [s] that the on-off law `place` left its heat on, and off, but for one in twenty: its minimum
    times are no longer. `memory`, in order, is of samples every `period` s; NaN for a proportional law, and where too
    few times are remembered as a whole, as of samples that come more often than every 5 min."""
    if not laws.switching[place] or not len(memory.times):
        return np.nan, np.nan
    column, power = int(laws.column[place]), laws.numbers[place, 0]
    times, first = np.unique(np.concatenate([memory.times, memory.times - period]), return_index=True)
    share = laws.sign[place] * np.concatenate([memory.inputs[:, column], memory.before[:, column]])[first] / power
    times, share = times[np.isfinite(share)], np.clip(share[np.isfinite(share)], 0.0, 1.0)
    apart = np.diff(times) != period
    found = []
    for part in (share, 1.0 - share):
        there = part > _NOTHING
        begins = np.flatnonzero((there[1:] != there[:-1]) | apart) + 1
        # The first and the last run may have been longer, and so may those beside a gap.
        whole = there[begins[:-1]] & ~apart[begins[:-1] - 1] & ~apart[begins[1:] - 1]
        lengths = np.add.reduceat(part, begins)[:-1][whole] if len(begins) else np.empty(0)
        found.append(period * float(np.quantile(lengths, _SELDOM)) if len(lengths) >= _FEW else np.nan)
    return found[0], found[1]


def _cools(network: Network, channel: str) -> bool:
    return all(
        heat.gain.constant < 0.0 or (heat.gain.constant == 0.0 and heat.gain.sign < 0.0)
        for heat in network.heat_inputs
        if heat.channel == channel
    )


def _disobeys(numbers: Array, x: Array, heat: Array) -> npt.NDArray[np.bool_]:
    """(n,): where next to nothing came although it is clearly called for, or most of the power although it is not;
    `numbers` are those of a proportional law, of which an on-off law departs by half of its hysteresis."""
    (called, idle), power = clear(numbers, x, 2.0 * _MARGIN), numbers[0]
    return (called & (heat < LITTLE * power)) | (idle & (heat > MUCH * power))


def _given(switching: int, numbers: Array, x: Array, before: Array) -> Array:
    power, offset, band = numbers.tolist()
    if switching:
        on = np.where(before > 0.5 * power, x > offset - 0.5 * band, x > offset + 0.5 * band)
        return power * on.astype(np.float64)
    return np.asarray(power * np.clip((x - offset) / band + 0.5, 0.0, 1.0), dtype=np.float64)


def _runs(times: Array, setpoints: Array) -> tuple[Array, int]:
    """(n,): numbers of slots at `times` (n,), ascending, which go on by 1 where a slot follows the one before under the
    same of `setpoints` (n,), and by more elsewhere; and how many slots make an hour."""
    gaps = np.diff(times)
    length = float(np.median(gaps)) if len(gaps) else _HOUR
    steps = np.where((gaps == length) & (np.diff(setpoints) == 0.0), 1.0, 2.0)
    return np.concatenate([[0.0], np.cumsum(steps)])[: len(times)], max(1, round(_HOUR / length))


def _hourly(values: Array, numbers: Array, count: int) -> Array:
    """(r, 2, m): means of `values` (r, n) over the two halves of each `count` slots that follow each other by their
    `numbers` (n,)."""
    begins = np.flatnonzero(numbers[count - 1 :] - numbers[: len(numbers) - count + 1] == count - 1)
    sums = np.cumsum(np.concatenate([np.zeros((len(values), 1)), values], axis=1), axis=1)
    edges = [begins, begins + (count + 1) // 2, begins + count // 2, begins + count]
    ends = [sums[:, edge] for edge in edges]
    return np.stack([ends[1] - ends[0], ends[3] - ends[2]], axis=1) / ((count + 1) // 2)


def _fitted(
    x: Array, heat: Array, before: Array, days: Array, runs: tuple[Array, int]
) -> tuple[float, Array, Array, float, float] | None:
    """Kind, numbers, covariance, share explained and days of the law behind `heat` (n,) at `x` (n,); None where there
    is no law. `before` (n,) is NaN where unknown, `days` (n,) tells the samples of one day from those of another, and
    `runs` those that follow each other (`_runs`)."""
    slots, hour = runs
    # Heat of an interval follows the temperatures from its beginning to its end.
    follows = np.append(np.diff(slots) == 1.0, False)
    between = np.where(follows, 0.5 * (x + np.append(x[1:], np.nan)), x)
    x = np.clip(x, -_REACH, _REACH)
    if len(x) >= _FEWEST and (heat > 0.0).any():
        # A boiler that is off for a day, or a valve that is stuck, is not the law.
        obeys = ~_disobeys(_proportional(x, heat, np.ones((1, len(x))))[0], x, heat)
        x, heat, before, days, slots, between = (rows[obeys] for rows in (x, heat, before, days, slots, between))
    variance = float(np.sum((heat - heat.mean()) ** 2)) if len(x) >= _FEWEST else 0.0
    if variance <= 0.0:
        return None
    names, day = np.unique(days, return_inverse=True)
    weights = _without_each(day, len(names))
    known = np.isfinite(before)
    candidates = [_proportional(x, heat, weights)]
    if _all_or_nothing(heat):
        candidates.append(_on_off(x, heat, np.where(known, before, 0.0), weights * known))
    given = [_given(switching, numbers[0], x, before) for switching, numbers in enumerate(candidates)]
    squares = [float(np.sum((heat - each) ** 2)) for each in given]
    switching = int(np.argmin(squares))
    explained = 1.0 - squares[switching] / variance
    if explained < _LEAST_EXPLAINED:
        return None
    numbers = candidates[switching]
    if not switching:
        numbers = _with_band(numbers, *_hourly(np.stack([between, heat, day]), slots, hour))
    return float(switching), numbers[0], _jackknife(numbers, len(names)), explained, float(len(names))


def _without_each(day: Indices, count: int) -> Array:
    """(1 + count, n): weights of samples in `day` (n,), a number: first of all days, then each time without one."""
    weights = np.ones((count + 1, len(day)))
    if count > 1:
        weights[1:][day[None] == np.arange(count)[:, None]] = 0.0
    return weights


def _jackknife(numbers: Array, days: int) -> Array:
    """(3, 3): covariance of the first row of `numbers` (1 + days, 3), the others being those without one day."""
    smallest = np.array(_SDS) * np.array([numbers[0, 0], 1.0, 1.0])
    if days < 2:
        # Of one day nobody knows how the next one differs.
        return np.diag((5.0 * smallest) ** 2)
    apart = numbers[1:] - np.median(numbers[1:], axis=0)
    # Without one day, the search may end in another valley: that is no spread of the valley that was found.
    usual = _FARTHEST * np.median(np.abs(apart), axis=0) + smallest / np.sqrt(days)
    apart = np.clip(apart, -usual, usual)
    covariance = (days - 1.0) / days * apart.T @ apart
    return np.asarray(covariance + np.diag(smallest**2), dtype=np.float64)


def _proportional(x: Array, heat: Array, weights: Array) -> Array:
    """(R, 3): the numbers of the proportional law with the least squares, for each row of `weights` (R, n)."""
    count = round(2.0 * _REACH / _BIN)
    place = np.minimum(((x + _REACH) / _BIN).astype(np.int64), count - 1)
    centres = -_REACH + _BIN * (np.arange(count) + 0.5)
    numbers, sums = (
        np.array([np.bincount(place, row * values, count) for row in weights]) for values in (np.ones(len(x)), heat)
    )
    most = float(heat.max())
    offsets, bands = np.linspace(-2.0, 2.0, 33), np.geomspace(_NARROWEST, 2.0 * _REACH, 24)
    grid = np.array([(offset, band) for offset in offsets for band in bands])
    best = np.empty((len(weights), 3))
    share = np.clip((centres - grid[:, :1]) / grid[:, 1:] + 0.5, 0.0, 1.0)
    for row, (n, s) in enumerate(zip(numbers, sums, strict=True)):
        power, squares = _power(share, n, s, most)
        first = int(np.argmin(squares))
        (offset, band), best[row, 0] = grid[first], power[first]
        width, ratio = offsets[1] - offsets[0], bands[1] / bands[0]
        for _ in range(_ZOOMS):
            near = offset + width * np.linspace(-1.0, 1.0, _SIDE)
            alike = np.maximum(band * ratio ** np.linspace(-1.0, 1.0, _SIDE), _NARROWEST)
            fine = np.array([(o, b) for o in near for b in alike])
            power, squares = _power(np.clip((centres - fine[:, :1]) / fine[:, 1:] + 0.5, 0.0, 1.0), n, s, most)
            chosen = int(np.argmin(squares))
            (offset, band), best[row, 0] = fine[chosen], power[chosen]
            width, ratio = width / 2.5, ratio**0.4
        best[row, 1:] = offset, band
    return best


def _with_band(numbers: Array, x: Array, heat: Array, day: Array) -> Array:
    """`numbers` (1 + days, 3) with offset and band by the medians of `x` (2, n) at shares of the power, `heat` (2, n)
    being means of the halves of hours; as they are where too few hours, or too few different shares, tell. An hour
    counts in which both halves had some of the power: others are the end of warming up or cooling down."""
    found, whole_day, level, mean = numbers.copy(), np.round(day[0]), x.mean(axis=0), heat.mean(axis=0)
    for row, (power, _, _) in enumerate(numbers):
        share, place = mean / power, np.digitize(heat / power, _SHARES)
        chosen = ((place > 0) & (place < len(_SHARES))).all(axis=0)
        if len(numbers) > 2 and row:
            chosen &= whole_day != row - 1
        of = np.digitize(share, _SHARES)
        bins, counts = np.unique(of[chosen], return_counts=True)
        if chosen.sum() < _FEWEST // 2 or len(bins) < 2:
            return numbers
        groups = [chosen & (of == one) for one in bins]
        centres = np.array([share[one].mean() for one in groups])
        medians = np.array([np.median(level[one]) for one in groups])
        slope, middle = np.polyfit(centres - 0.5, medians, 1, w=np.sqrt(counts))
        found[row, 1:] = middle, max(slope, _NARROWEST)
    return found


def _power(share: Array, numbers: Array, sums: Array, most: float) -> tuple[Array, Array]:
    """Power (G,), at most `most`, and squares (G,) up to a constant of G laws that give `share` (G, bins) of it."""
    squared, crossed = share**2 @ numbers, share @ sums
    power = np.minimum(crossed / np.maximum(squared, 1e-9), most)
    return power, power**2 * squared - 2.0 * power * crossed


def _all_or_nothing(heat: Array) -> bool:
    """Whether most of the slots with heat (n,) have all of it."""
    some = heat[heat > LITTLE * heat.max()]
    return bool(np.median(some) >= _ALL * np.quantile(some, 0.9))


def _on_off(x: Array, heat: Array, before: Array, weights: Array) -> Array:
    """(R, 3): the same for the on-off law, in closed form: a threshold for those that were off, one for the others."""
    power = float(np.median(heat[heat > 0.5 * heat.max()]))
    order = np.argsort(x, kind="stable")
    sorted_x, gain = x[order], (heat**2 - (heat - power) ** 2)[order]
    on = (before > 0.5 * power)[order]
    edges = np.concatenate([[-_REACH], 0.5 * (sorted_x[1:] + sorted_x[:-1]), [_REACH]])
    found = np.empty((len(weights), 3))
    for row, own in enumerate(weights[:, order]):
        thresholds = []
        for group in (on, ~on):
            # Squares saved by power above a threshold: all that comes after it.
            after = np.concatenate([[0.0], np.cumsum((own * gain * group)[::-1])])[::-1]
            best = np.flatnonzero(after >= after.max() - 1e-6 * power**2)
            thresholds.append(float(edges[best[len(best) // 2]]))
        off_at, on_at = thresholds
        found[row] = power, 0.5 * (on_at + off_at), max(on_at - off_at, 0.0)
    return found
