"""Members' forecasts made one: weighted, and scaled about their mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from estimator.arrays import Array
from estimator.types import Mixture


def mixed(parts: Sequence[Mixture], shares: Array, scale: float) -> Mixture:
    """One mixture of `parts` with `shares` (E,) that add up to 1, stretched by `scale` about its mean."""
    chosen = np.flatnonzero(shares > 0.0).tolist()
    mixture = Mixture(
        np.concatenate([shares[e] / parts[e].weights.sum() * parts[e].weights for e in chosen]),
        np.concatenate([parts[e].means for e in chosen], axis=1),
        np.concatenate([np.broadcast_to(parts[e].sds, parts[e].means.shape) for e in chosen], axis=1),
    )
    centre = mixture.mean()[:, None]
    return mixture._replace(means=centre + scale * (mixture.means - centre), sds=scale * mixture.sds)


def mixed_futures(futures: Sequence[Sequence[Mixture]], shares: Array, scales: Array) -> Iterator[Mixture]:
    """The same lead by lead: `futures` of each member over L leads, `shares` (E, L), `scales` (L,)."""
    weights, means, sds = [], [], []
    for parts, own in zip(futures, shares, strict=True):
        member = np.array([part.weights for part in parts])
        weights.append(own[:, None] / member.sum(axis=1, keepdims=True) * member)
        means.append(np.array([part.means for part in parts]))
        sds.append(np.broadcast_to(np.array([part.sds for part in parts]), means[-1].shape))
    weight, mean, sd = (np.concatenate(rows, axis=-1) for rows in (weights, means, sds))
    centre = (weight[:, None] * mean).sum(axis=-1, keepdims=True)
    mean -= centre
    mean *= scales[:, None, None]
    mean += centre
    sd *= scales[:, None, None]
    yield from (Mixture(*of_lead) for of_lead in zip(weight, mean, sd, strict=True))
