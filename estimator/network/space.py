"""The coordinates in which parameters are learned, and their prior (paper 3.4.3).

The prior is log-uniform on the box, as the paper's, or log-normal about a typical value and cut off at the box.

phi = log theta lies in the box [log theta_min, log theta_max]. Two coordinates are offered: "log", phi itself, where
jittered values are clipped to the box (as the authors' runs do), and "logit", the logit of phi's place in the box,
which has no edge to clip at: with clipping, and no data at all, the variance of phi falls to a quarter in 2,000 steps.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import expit, logit, ndtr, ndtri

from estimator.arrays import Array, Indices
from estimator.network.network import Network


class ParameterSpace(NamedTuple):
    """Where theta lives.

    `lower` and `upper` (d,) bound phi. `typical` (d,) is the centre of a log-normal prior with the standard deviation
    `spread` (d,), NaN for a log-uniform one; `free` (d,) are its entries of theta, `fixed` (n_theta,) fills the others.
    """

    lower: Array
    upper: Array
    typical: Array
    spread: Array
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

    def from_logs(self, phi: Array) -> Array:
        """theta (n_theta,), fixed entries included, from phi (d,)."""
        theta = self.fixed.copy()
        theta[self.free] = np.exp(phi)
        return theta

    @property
    def prior_variance(self) -> Array:
        """(d,): of phi; for a log-normal prior without regard to the little that the box cuts off."""
        uniform = (self.upper - self.lower) ** 2 / 12.0
        return np.where(np.isnan(self.typical), uniform, np.minimum(uniform, self.spread**2))

    def from_uniform(self, place: Array, share: float = 1.0) -> Array:
        """Coordinates (d, N) of `place` (d, N) in the unit box: draws from the prior when `place` is uniform.

        With a `share` below 1 they lie closer to the middle, and their standard deviation is that share of the prior's.
        """
        place = self._placed(place, share)
        if self.logit:
            edge = np.finfo(float).eps
            return logit(np.clip(place, edge, 1 - edge))
        return self.lower[:, None] + (self.upper - self.lower)[:, None] * place

    def _placed(self, place: Array, share: float) -> Array:
        """`place` moved to where the prior's distribution has it in the box, and towards the middle."""
        placed = place if share == 1.0 else 0.5 + share * (place - 0.5)
        normal = ~np.isnan(self.typical)
        if not normal.any():
            return placed
        low, high, centre, sd = (rows[normal, None] for rows in (self.lower, self.upper, self.typical, self.spread))
        below, above = ndtr((low - centre) / sd), ndtr((high - centre) / sd)
        middle, drawn = (ndtri(below + (above - below) * part) for part in (0.5, place[normal]))
        placed = placed.copy()
        placed[normal] = (centre + sd * middle + share * (sd * (drawn - middle)) - low) / (high - low)
        return np.clip(placed, 0.0, 1.0)

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
        typical=np.log([np.nan if box.typical is None else box.typical for box in boxes]),
        spread=np.array([box.spread for box in boxes], dtype=np.float64),
        free=np.array(free, dtype=np.int64),
        fixed=np.array([np.nan if p.free else p.nominal for p in network.parameters], dtype=np.float64),
        logit=logit,
    )
