"""Members' forecasts made one: held together about their middle, weighted, and scaled about their mean.

Weights that rest on few verified forecasts mean little, and a single wild member would spoil the mean. So nobody goes
farther from the weighted median of the members' means than a reach, in units of the weighted median of their spreads.
The reach grows with every verified forecast: nearly a median in the beginning, a mixture in the end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.arrays import Array
from estimator.types import Mixture, Mixtures


def mixed(parts: Sequence[Mixture], shares: Array, scale: float, reach: float | None = None) -> Mixture:
    """One mixture of `parts` with `shares` (E,) that add up to 1, stretched by `scale` about its mean.

    Nothing holds them together without a `reach`.
    """
    futures = [Mixtures.of_one(part) for part in parts]
    reaches = None if reach is None else np.array([reach])
    return mixed_futures(futures, shares[:, None], np.array([scale]), reaches).at(0)


def mixed_futures(futures: Sequence[Mixtures], shares: Array, scales: Array, reaches: Array | None = None) -> Mixtures:
    """The same lead by lead: `futures` of each member over L leads, `shares` (E, L), `scales` and `reaches` (L,)."""
    chosen = np.flatnonzero(shares.max(axis=1) > 0.0).tolist()
    shares, futures = shares[chosen], [futures[e] for e in chosen]
    held = futures if reaches is None else _held_together(futures, shares, reaches)
    weights = np.concatenate(
        [
            own[:, None] / one.weights.sum(axis=1, keepdims=True) * one.weights
            for own, one in zip(shares, held, strict=True)
        ],
        axis=1,
    )
    means, sds = (np.concatenate([one[place] for one in held], axis=2) for place in (1, 2))
    centre = (weights[:, None] * means).sum(axis=2, keepdims=True)
    stretch = scales[:, None, None]
    return Mixtures(weights, centre + stretch * (means - centre), stretch * sds)


def stretched(mixture: Mixture, scale: float) -> Mixture:
    """`mixture` with every distance from its mean `scale` times as long."""
    centre = mixture.mean()[:, None]
    return mixture._replace(means=centre + scale * (mixture.means - centre), sds=scale * mixture.sds)


def _held_together(futures: Sequence[Mixtures], shares: Array, reaches: Array) -> list[Mixtures]:
    """`futures` with none of them beyond `reaches` (L,) of their middle."""
    means, sds = (np.stack(moments) for moments in zip(*(one.moments() for one in futures), strict=True))
    middle, limit = _weighted_median(means, shares), reaches[:, None] * _weighted_median(sds, shares)
    moves = np.clip(means, middle - limit, middle + limit) - means
    return [one._replace(means=one.means + move[..., None]) for one, move in zip(futures, moves, strict=True)]


def _weighted_median(values: Array, shares: Array) -> Array:
    """(L, n_y) of `values` (E, L, n_y) with `shares` (E, L); halfway between two where both are one."""
    order = np.argsort(values, axis=0)
    ranked = np.take_along_axis(values, order, axis=0)
    below = np.cumsum(np.take_along_axis(np.broadcast_to(shares[..., None], values.shape), order, axis=0), axis=0)
    half = 0.5 * below[-1]
    # Rounding must not decide between two members that weigh the same.
    lower, upper = (np.argmax(below > half * edge, axis=0)[None] for edge in (1.0 - 1e-9, 1.0 + 1e-9))
    return np.asarray(0.5 * (np.take_along_axis(ranked, lower, axis=0) + np.take_along_axis(ranked, upper, axis=0))[0])
