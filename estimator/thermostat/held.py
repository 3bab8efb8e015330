"""Rooms that their thermostat holds: how far they stray from what a simulation of the law says.

A proportional law holds a room while it gives some of its power, an on-off law while it switches: how far a room swings
beyond the hysteresis depends on how fast it warms. The errors of the last verified forecasts that had the room held
stand for those to come: they are added, one to each future, which keeps it over time. What futures differ by already is
taken off the errors, so that both together spread as the errors do.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from estimator.arrays import Array, Indices
from estimator.bank.weights import between
from estimator.thermostat.law import Laws, clear
from estimator.types import Mixture, Mixtures

HELD, IDLE, FORCED = 0, 1, 2
"""A future in which the thermostat holds the room; all are off, as in a setback or in the sun; one gives all it has."""

_KEPT = 120
"""Errors of each lead: five days of hourly forecasts."""

_FIRST = 0.3
"""K: standard deviation of the errors before any was seen."""

_MARGIN = 0.05
"""K beyond its band up to which a proportional law holds a room."""

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def no_errors(leads: int) -> Array:
    """(leads, N): nothing was verified."""
    return np.tile(_FIRST * ndtri((np.arange(_KEPT) * _GOLDEN + 0.5 / _KEPT) % 1.0), (leads, 1))


def with_error(errors: Array, lead: int, error: float) -> Array:
    """`errors` (H, N) after one more [K] at a lead, which replaces the oldest."""
    after = errors.copy()
    after[lead] = np.append(errors[lead, 1:], error)
    return after


def states(temperatures: Array, laws: Laws, setpoints: Array, on: Array) -> Indices:
    """(L, K): HELD, IDLE or FORCED at each of L times in each of K futures of the room's `temperatures` (L, K), under
    `setpoints` (L,) [degC], each law having been `on` for a share (L, K, n_laws) of the hour before; IDLE where nobody
    sets one."""
    found = np.full(temperatures.shape, IDLE, dtype=np.int64)
    for place, (numbers, side) in enumerate(zip(laws.numbers, laws.side, strict=True)):
        x = side * (setpoints[:, None] - temperatures)
        called, idle = clear(numbers, x, _MARGIN)
        if laws.switching[place]:
            called, idle = on[:, :, place] == 1.0, on[:, :, place] == 0.0
        found[called & ~np.isnan(x)] = FORCED
        found[~called & ~idle & ~np.isnan(x)] = HELD
    return found


def spread_out(errors: Array, leads: Sequence[int], wanted: Array, counts: Sequence[int]) -> Array:
    """(L, N): the error of each of N futures, `counts` of each member, at the `wanted` leads (L,), from `errors`
    (H, M) at `leads`: evenly by rank, between two leads linear in their logarithm."""
    ranks = np.concatenate([(np.arange(count) + 0.5) * _GOLDEN % 1.0 for count in counts])
    sorted_errors = np.sort(errors, axis=1)
    chosen = sorted_errors[:, (ranks * errors.shape[1]).astype(np.int64)]
    return between(chosen.T, leads, wanted).T


def strayed(futures: Mixtures, states: Indices, scales: Array, errors: Array) -> Mixtures:
    """`futures` of L times: HELD ones of `states` (L, N) with the `errors` (L, N) of the first output [K], the others
    stretched about the mean by `scales` (2, L), those of IDLE and FORCED ones. Further outputs count as IDLE."""
    centre = (futures.weights[:, None] * futures.means).sum(axis=2, keepdims=True)
    stretch = np.tile(scales[0, :, None, None], futures.means.shape[1:])
    stretch[:, 0] = np.choose(states, [np.ones_like(errors), stretch[:, 0], scales[1, :, None]])
    means = centre + stretch * (futures.means - centre)
    held = states == HELD
    means[:, 0] += np.where(held, _beyond(futures, held, errors), 0.0)
    return Mixtures(futures.weights, means, stretch * futures.sds)


def _beyond(futures: Mixtures, held: npt.NDArray[np.bool_], errors: Array) -> Array:
    """(L, N): `errors` drawn together by as much as the futures that are held spread already."""
    shares = np.where(held, futures.weights, 0.0) + 1e-12
    shares /= shares.sum(axis=1, keepdims=True)
    middle, centre = ((shares * rows).sum(axis=1, keepdims=True) for rows in (errors, futures.means[:, 0]))
    spread = (shares * (futures.sds[:, 0] ** 2 + (futures.means[:, 0] - centre) ** 2)).sum(axis=1, keepdims=True)
    whole = (shares * (errors - middle) ** 2).sum(axis=1, keepdims=True)
    left = np.sqrt(np.clip(1.0 - spread / np.maximum(whole, 1e-12), 0.0, 1.0))
    return np.asarray(middle + left * (errors - middle))


def strayed_by_all(mixture: Mixture, states: Indices, scales: Array, errors: Array) -> Mixture:
    """`strayed` of one time with `scales` (2,), in which every future, of `states` (K,), has each of `errors` (N,)."""
    repeated = Mixtures.of_one(Mixture(*(np.repeat(part, len(errors), axis=-1) for part in mixture)))
    repeated = repeated._replace(weights=repeated.weights / len(errors))
    every, of = np.tile(errors, len(states))[None], np.repeat(states, len(errors))[None]
    return strayed(repeated, of, scales[:, None], every).at(0)
