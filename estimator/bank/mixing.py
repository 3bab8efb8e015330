"""Members' forecasts made one: held together about their middle, weighted, and scaled about their mean.

Weights that rest on few verified forecasts mean little, and a single wild member would spoil the mean and the tails. So
nobody goes farther from the weighted median of the members' means than a reach, in units of the weighted median of
their spreads, nor spreads more than four times as wide as that. The reach grows with every verified forecast: nearly a
median in the beginning, a mixture in the end. Nor does anybody on average leave the `bounds` of what a
room can do, where they are known.
"""

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from estimator.arrays import Array
from estimator.types import Mixture, Mixtures

_TINY = 1e-300

_WIDEST = 4.0
"""Reaches that a member may spread."""


def mixed(
    parts: Sequence[Mixture], shares: Array, scale: float, reach: float | None = None, bounds: Array | None = None
) -> Mixture:
    """One mixture of `parts` with `shares` (E,) that add up to 1, stretched by `scale` about its mean.

    Nothing holds them together without a `reach`, which `bounds` (n_y, 2) [degC] need as well.
    """
    futures = [Mixtures.of_one(part) for part in parts]
    reaches = None if reach is None else np.array([reach])
    return mixed_futures(futures, shares[:, None], np.array([scale]), reaches, bounds).at(0)


def mixed_futures(
    futures: Sequence[Mixtures],
    shares: Array,
    scales: Array,
    reaches: Array | None = None,
    bounds: Array | None = None,
) -> Mixtures:
    """The same lead by lead: `futures` of each member over L leads, `shares` (E, L), `scales` and `reaches` (L,)."""
    chosen = np.flatnonzero(shares.max(axis=1) > 0.0).tolist()
    ends = np.cumsum([futures[e].weights.shape[1] for e in chosen])
    weights = np.concatenate([futures[e].weights for e in chosen], axis=1)
    means, sds = (np.concatenate([futures[e][place] for e in chosen], axis=2) for place in (1, 2))
    limits = np.full(len(scales), np.inf) if reaches is None else reaches
    room = np.tile([-np.inf, np.inf], (means.shape[1], 1)) if bounds is None else bounds
    _mix(ends, shares[chosen], scales, limits, room, weights, means, sds)
    return Mixtures(weights, means, sds)


def stretched(mixture: Mixture, scale: float) -> Mixture:
    """`mixture` with every distance from its mean `scale` times as long."""
    centre = mixture.mean()[:, None]
    return mixture._replace(means=centre + scale * (mixture.means - centre), sds=scale * mixture.sds)


@njit(cache=True, nogil=True)
def _mix(ends, shares, scales, reaches, bounds, weights, means, sds):  # type: ignore[no-untyped-def]
    """`weights` (L, N), `means` and `sds` (L, n_y, N) of members whose components end at `ends` (E,), in place."""
    members, outputs = len(ends), means.shape[1]
    centres, spreads = np.empty(members), np.empty(members)
    for t in range(len(weights)):
        begin = 0
        for e in range(members):
            whole = 0.0
            for n in range(begin, ends[e]):
                whole += weights[t, n]
            for n in range(begin, ends[e]):
                weights[t, n] *= shares[e, t] / whole
            begin = ends[e]
        for y in range(outputs):
            if reaches[t] < np.inf:
                _moments(ends, weights[t], means[t, y], sds[t, y], shares[:, t], centres, spreads)
                kept = np.minimum(np.maximum(centres, bounds[y, 0]), bounds[y, 1])
                middle = _weighted_median(kept, shares[:, t])
                limit = reaches[t] * _weighted_median(spreads, shares[:, t])
                begin = 0
                for e in range(members):
                    near = min(max(kept[e], middle - limit), middle + limit)
                    narrower = min(_WIDEST * limit / max(spreads[e], _TINY), 1.0)
                    for n in range(begin, ends[e]):
                        means[t, y, n] = near + narrower * (means[t, y, n] - centres[e])
                        sds[t, y, n] *= narrower
                    begin = ends[e]
            centre = 0.0
            for n in range(len(weights[t])):
                centre += weights[t, n] * means[t, y, n]
            for n in range(len(weights[t])):
                means[t, y, n] = centre + scales[t] * (means[t, y, n] - centre)
                sds[t, y, n] *= scales[t]


@njit(cache=True, nogil=True)
def _moments(ends, weights, means, sds, shares, centres, spreads):  # type: ignore[no-untyped-def]
    """`centres` and `spreads` (E,): mean and standard deviation of each member. Who has no share has those of its first
    component, which count for nothing."""
    begin = 0
    for e in range(len(ends)):
        first, second = 0.0, 0.0
        share = max(shares[e], _TINY)
        for n in range(begin, ends[e]):
            away = means[n] - means[begin]
            first += weights[n] / share * away
            second += weights[n] / share * (away * away + sds[n] * sds[n])
        centres[e], spreads[e] = means[begin] + first, math.sqrt(max(second - first * first, 0.0))
        begin = ends[e]


@njit(cache=True, nogil=True)
def _weighted_median(values, shares):  # type: ignore[no-untyped-def]
    """Of `values` (E,) with `shares` (E,); halfway between two where both are one."""
    order = np.argsort(values)
    half, below = 0.5 * shares.sum(), 0.0
    lower, upper = np.nan, np.nan
    for e in order:
        below += shares[e]
        # Rounding must not decide between two members that weigh the same.
        if np.isnan(lower) and below > half * (1.0 - 1e-9):
            lower = values[e]
        if np.isnan(upper) and below > half * (1.0 + 1e-9):
            upper = values[e]
    return 0.5 * (lower + (lower if np.isnan(upper) else upper))
