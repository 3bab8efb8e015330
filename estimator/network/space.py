"""The coordinates in which parameters are learned, and their log-uniform prior (paper 3.4.3).

phi = log theta lies in the box [log theta_min, log theta_max]. Two coordinates are offered: "log", phi itself, where
jittered values are clipped to the box (as the authors' runs do), and "logit", the logit of phi's place in the box,
which has no edge to clip at: with clipping, and no data at all, the variance of phi falls to a quarter in 2,000 steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import expit, logit

from estimator.arrays import Array, Indices
from estimator.network.network import Network


class ParameterSpace(NamedTuple):
    """Where theta lives.

    `lower` and `upper` (d,) bound phi, `free` (d,) are its entries of theta, `fixed` (n_theta,) fills the others.
    """

    lower: Array
    upper: Array
    free: Indices
    fixed: Array
    logit: bool

    def log_parameters(self, coordinates: Array) -> Array:
        """phi (d, N) from coordinates (d, N)."""
        if not self.logit:
            return coordinates
        return self.lower[:, None] + (self.upper - self.lower)[:, None] * expit(coordinates)

    def parameters(self, coordinates: Array) -> Array:
        """theta (n_theta, N), fixed entries included, from coordinates (d, N)."""
        theta = np.repeat(self.fixed[:, None], coordinates.shape[1], axis=1)
        theta[self.free] = np.exp(self.log_parameters(coordinates))
        return theta

    def from_uniform(self, place: Array) -> Array:
        """Coordinates (d, N) of `place` (d, N) in the unit box: the log-uniform prior (23) when `place` is uniform."""
        if self.logit:
            edge = np.finfo(float).eps
            coordinates: Array = logit(np.clip(place, edge, 1 - edge))
            return coordinates
        return self.lower[:, None] + (self.upper - self.lower)[:, None] * place

    def confine(self, coordinates: Array) -> Array:
        """Coordinates back inside the box: clipping in log space, nothing to do in logit space."""
        if self.logit:
            return coordinates
        return np.clip(coordinates, self.lower[:, None], self.upper[:, None])


def parameter_space(network: Network, *, logit: bool) -> ParameterSpace:
    """The space of a validated network's free parameters."""
    free = [index for index, parameter in enumerate(network.parameters) if parameter.free]
    boxes = [network.parameters[index] for index in free]
    return ParameterSpace(
        lower=np.log([box.lower for box in boxes]),
        upper=np.log([box.upper for box in boxes]),
        free=np.array(free, dtype=np.int64),
        fixed=np.array([np.nan if p.free else p.nominal for p in network.parameters], dtype=np.float64),
        logit=logit,
    )
