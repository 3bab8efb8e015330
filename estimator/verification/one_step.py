"""The forecast of the next sample, as it is told and scored: moments and central intervals of every output."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.types import Mixture


class OneStep(NamedTuple):
    """Of n_y outputs at one time, in degC and K, with central intervals at L levels."""

    levels: tuple[float, ...]
    """(L,): in (0, 1)."""
    mean: Array
    """(n_y,)."""
    sd: Array
    """(n_y,)."""
    median: Array
    """(n_y,)."""
    lower: Array
    """(n_y, L)."""
    upper: Array
    """(n_y, L)."""

    def interval(self, level: float, output: int) -> tuple[float, float] | None:
        """Bounds of the interval at `level` of one output; None where `level` is none of `levels`."""
        if level not in self.levels:
            return None
        place = self.levels.index(level)
        return float(self.lower[output, place]), float(self.upper[output, place])


def one_step(mixture: Mixture, levels: Sequence[float]) -> OneStep:
    """Moments and intervals at `levels` of a forecast `mixture`."""
    tails = np.array([0.5, *(0.5 - level / 2 for level in levels), *(0.5 + level / 2 for level in levels)])
    found, first = np.array([mixture.quantiles(tails, output) for output in range(len(mixture.means))]), 1 + len(levels)
    return OneStep(tuple(levels), mixture.mean(), mixture.sd(), found[:, 0], found[:, 1:first], found[:, first:])
