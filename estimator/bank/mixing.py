"""Members' forecasts made one: weighted, and scaled about their mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.arrays import Array
from estimator.types import Mixture, Mixtures


def mixed(parts: Sequence[Mixture], shares: Array, scale: float) -> Mixture:
    """One mixture of `parts` with `shares` (E,) that add up to 1, stretched by `scale` about its mean."""
    chosen = np.flatnonzero(shares > 0.0).tolist()
    mixture = Mixture(
        np.concatenate([shares[e] / parts[e].weights.sum() * parts[e].weights for e in chosen]),
        np.concatenate([parts[e].means for e in chosen], axis=1),
        np.concatenate([parts[e].sds for e in chosen], axis=1),
    )
    return stretched(mixture, scale)


def stretched(mixture: Mixture, scale: float) -> Mixture:
    """`mixture` with every distance from its mean `scale` times as long."""
    centre = mixture.mean()[:, None]
    return mixture._replace(means=centre + scale * (mixture.means - centre), sds=scale * mixture.sds)


def mixed_futures(futures: Sequence[Mixtures], shares: Array, scales: Array) -> Mixtures:
    """The same lead by lead: `futures` of each member over L leads, `shares` (E, L), `scales` (L,)."""
    each = list(zip(futures, shares, strict=True))
    weights = np.concatenate(
        [own[:, None] / one.weights.sum(axis=1, keepdims=True) * one.weights for one, own in each], axis=1
    )
    means = np.concatenate([one.means for one in futures], axis=2)
    sds = np.concatenate([one.sds for one in futures], axis=2)
    centre = (weights[:, None] * means).sum(axis=2, keepdims=True)
    means -= centre
    means *= scales[:, None, None]
    means += centre
    sds *= scales[:, None, None]
    return Mixtures(weights, means, sds)
