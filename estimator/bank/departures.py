"""What a plan of heating changes about what usually follows.

A regression knows heating by what usually goes with it, and so does a model that takes all it cannot explain for noise.
Under the usual heating both foretell well what follows. A plan departs from that, and what the departure changes is a
matter of physics: the difference of two futures of the same model, under the plan and under the heating of the day
before. What the model has wrong about the level of the room, as all do in the first days, is in both.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from estimator.arrays import Array
from estimator.bank.weights import counting
from estimator.types import Mixtures


class Departure(NamedTuple):
    """What a plan changes at L leads of n_y outputs [K]."""

    mean: Array
    """(L, n_y)."""
    sd: Array
    """(L, n_y): how far the members differ about it, and how much more they doubt the plan than the usual course."""

    def of(self, usual: Mixtures) -> Mixtures:
        """What the plan makes of the `usual` course."""
        sds = np.sqrt(usual.sds**2 + self.sd[..., None] ** 2)
        return usual._replace(means=usual.means + self.mean[..., None], sds=sds)


def departure(planned: Mapping[int, Mixtures], usual: Mapping[int, Mixtures], shares: Array) -> Departure:
    """What a plan changes, by the futures of members, by their places, when it is `planned` and as `usual`, at L leads,
    at which they have `shares` (E, L)."""
    asked = np.flatnonzero(counting(shares)).tolist()
    each = [(*planned[place].moments(), *usual[place].moments()) for place in asked]
    changes = np.array([under - mean for under, _, mean, _ in each])
    spreads = np.array([np.maximum(wider**2 - sd**2, 0.0) for _, wider, _, sd in each])
    known = (shares[asked] / shares[asked].sum(axis=0))[..., None]
    mean = (known * changes).sum(axis=0)
    return Departure(mean, np.sqrt((known * ((changes - mean) ** 2 + spreads)).sum(axis=0)))


def as_usual(plan: Array, past: Array, heat: Sequence[int], day: int, hour: int) -> Array:
    """`plan` (h, n) with the columns `heat` as the `day` steps before, the last of the rows `past` (m, n), in means
    over `hour` steps, for no relay switches at the same minute; and as their mean where there are fewer."""
    rows, known = plan.copy(), past[-day:, heat]
    if len(known) == day:
        rows[:, heat] = uniform_filter1d(known, hour, axis=0, mode="wrap")[np.arange(len(plan)) % day]
    else:
        rows[:, heat] = known.mean(axis=0)
    return rows
