"""Weights of the members, horizon by horizon, from what their forecasts have cost so far.

The weight of member e at a horizon is proportional to p_e exp(-r R_e): p_e its weight a priori, r the learning rate and
R_e the sum, discounted over time, of what a little more trust in the member would have cost. For a mixture with weights
w of forecasts X_e that is, by the gradient of the CRPS,

    l_e = E|X_e - y| - sum_f w_f E|X_e - X_f|,

so that a member earns trust by being good and by being unlike the others: the weights approach the best mixture, not
the best member (exponentiated gradient, CRPS learning: Berrisch and Ziel 2021). Its unit is what the mixture itself
costs, so that the rate suits every building, and it is bounded, so that one surprise does not decide.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array, Mask
from estimator.types import Mixture
from estimator.verification.scores import expected_distance, merged

COMPONENTS = 12
"""Gaussians that stand for a member when its share in the mixture's score is computed."""

NEGLIGIBLE = 0.01
"""Weight below which, if it has no more at any lead of a forecast, a member is left out of it."""

_LARGEST = 20.0
"""Bound of the cost of one forecast, in units of the mixture's. A lower one spares members that are far off whenever
something happens, in a room where mostly nothing does."""


class Costs(NamedTuple):
    """Discounted sums over E members and H horizons, the first of which is one step."""

    excess: Array
    """(E, H): R, in hours of the mixture's own cost."""
    whole: Array
    """(H,): of the mixture's CRPS [K], times hours."""
    hours: Array
    """(H,): hours that they stand for."""


def no_costs(members: int, horizons: int) -> Costs:
    """Nothing has been verified."""
    return Costs(np.zeros((members, horizons)), np.zeros(horizons), np.zeros(horizons))


def with_cost(costs: Costs, horizon: int, cost: Array, whole: float, hours: float, discount: float) -> Costs:
    """`costs` after a forecast `horizon` ahead: `cost` (E,) by member and `whole` of the mixture [K].

    It stands for `hours`, and an hour leaves `discount` of older ones.
    """
    kept = discount**hours
    excess, sums, total = costs.excess.copy(), costs.whole.copy(), costs.hours.copy()
    total[horizon] = kept * total[horizon] + hours
    sums[horizon] = kept * sums[horizon] + hours * whole
    unit = max(sums[horizon] / total[horizon], 1e-9)
    excess[:, horizon] = kept * excess[:, horizon] + hours * np.clip((cost - cost.min()) / unit, 0.0, _LARGEST)
    return Costs(excess, sums, total)


def weights(costs: Costs, prior: Array, rate: float, sharing: float) -> Array:
    """Weights (E, H) of the members from the `prior` (E, H) and the learning `rate` [per hour].

    A day ahead there is little evidence: of what counts at a horizon, `sharing` counts at the next longer one as well.
    """
    return _weights(costs.excess, prior, rate, sharing)


def costs_of(parts: Sequence[Mixture], now: Array, output: int, value: float) -> tuple[Array, float]:
    """Cost (E,) [K] of a little more weight on each of `parts`, and of their mixture with weights `now` (E,)."""
    cost, whole = _costs(
        np.array([len(part.weights) for part in parts]),
        np.concatenate([part.weights for part in parts]),
        np.concatenate([part.means[output] for part in parts]),
        np.concatenate([part.sds[output] for part in parts]),
        now,
        value,
    )
    return cost, whole


@njit(cache=True, nogil=True)
def _weights(excess, prior, rate, sharing):  # type: ignore[no-untyped-def]
    members, horizons = excess.shape
    found, counted = np.empty((members, horizons)), np.zeros(members)
    for horizon in range(horizons):
        for e in range(members):
            counted[e] = excess[e, horizon] + sharing * counted[e]
            found[e, horizon] = math.log(prior[e, horizon]) - rate * counted[e]
        largest, whole = found[:, horizon].max(), 0.0
        for e in range(members):
            found[e, horizon] = math.exp(found[e, horizon] - largest)
            whole += found[e, horizon]
        for e in range(members):
            found[e, horizon] /= whole
    return found


@njit(cache=True, nogil=True)
def _costs(sizes, all_weights, all_means, all_sds, now, value):  # type: ignore[no-untyped-def]
    """What `costs_of` tells of mixtures with `sizes` (E,) components, of which at most COMPONENTS of each are counted
    (`reduced`)."""
    members, count = len(sizes), COMPONENTS
    owner, whole = np.empty(members * count, np.int64), 0
    weights, means, sds = np.empty(members * count), np.empty(members * count), np.empty(members * count)
    begin = 0
    for e in range(members):
        end = begin + sizes[e]
        shares, centres, spreads = all_weights[begin:end], all_means[begin:end], all_sds[begin:end]
        if sizes[e] > count:
            shares, small_means, small_sds = merged(shares, centres.reshape(1, -1), spreads.reshape(1, -1), count)
            centres, spreads = small_means[0], small_sds[0]
        for n in range(len(shares)):
            owner[whole], weights[whole], means[whole], sds[whole] = e, shares[n], centres[n], spreads[n]
            whole += 1
        begin = end
    near, others, total = np.zeros(members), np.zeros(members), 0.0
    for i in range(whole):
        near[owner[i]] += weights[i] * expected_distance(value - means[i], sds[i])
        for j in range(i + 1):
            sd = math.sqrt(sds[i] * sds[i] + sds[j] * sds[j])
            share = weights[i] * weights[j] * expected_distance(means[i] - means[j], sd)
            others[owner[i]] += share * now[owner[j]]
            if j < i:
                others[owner[j]] += share * now[owner[i]]
    for e in range(members):
        total += now[e] * (near[e] - 0.5 * others[e])
    return near - others, total


def counting(shares: Array) -> Mask:
    """(E,): who is not left out of a forecast with `shares` (E, L) of the members."""
    return np.asarray(shares.max(axis=1) >= NEGLIGIBLE)


def between(values: Array, leads: Sequence[int], wanted: Array) -> Array:
    """`values` (..., H), given at `leads`, at the `wanted` ones (L,): linear in their logarithm, constant beyond."""
    place = np.interp(np.log(wanted), np.log(leads), np.arange(len(leads)))
    low = np.minimum(place.astype(np.int64), len(leads) - 1)
    high = np.minimum(low + 1, len(leads) - 1)
    share = place - low
    return values[..., low] * (1.0 - share) + values[..., high] * share
