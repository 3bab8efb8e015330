"""Heat meters of several zones: from watts of the meter to those of one zone, and back."""

from typing import NamedTuple, Self

import numpy as np
from scipy.special import ndtri

from estimator.arrays import Array, Indices
from estimator.types import ModelDraws
from service.zone.worker import ZoneWorker

_LEVELS = (0.025, 0.5, 0.975)
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


class Shares(NamedTuple):
    """Watts of a zone per unit of each of its inputs, log-normal; exactly 1 for what is no meter of several zones."""

    medians: Array
    """(n_u,)."""
    spreads: Array
    """(n_u,): standard deviations of the logarithms."""

    @classmethod
    def of(cls, worker: ZoneWorker) -> Self:
        """As `worker` has learned them; where its estimator knows no building, as they are likely."""
        network = worker.network
        found = cls(np.ones(len(network.inputs)), np.zeros(len(network.inputs)))
        summary = worker.parameters(_LEVELS) if network.shares else None
        for channel, place in network.shares.items():
            column, likely = network.inputs.index(channel), network.parameters[place].typical
            lower, median, upper = (np.nan,) * 3 if summary is None else summary.parameters[place].tolist()
            found.medians[column] = median if np.isfinite(median) else likely or 1.0
            found.spreads[column] = np.log(upper / lower) / (2.0 * ndtri(_LEVELS[-1])) if lower > 0.0 else 0.0
        return found

    @property
    def quantiles(self) -> Array:
        """(3, n_u): shares at levels of 2.5, 50 and 97.5 %."""
        return np.asarray(self.medians * np.exp(self.spreads * ndtri(_LEVELS)[:, None]))

    def sampled(self, columns: Indices, count: int) -> Array:
        """(count, L): shares of the inputs `columns` (L,) in as many futures, the same ones at every call."""
        ranks = (0.5 + np.arange(count) * _GOLDEN) % 1.0
        return np.asarray(self.medians[columns] * np.exp(self.spreads[columns] * ndtri(ranks)[:, None]))


def in_own_watts(draws: ModelDraws) -> ModelDraws:
    """`draws` whose inputs are watts of the zone itself."""
    places = list(draws.network.shares.values())
    theta, point = draws.theta.copy(), draws.point.copy()
    theta[places], point[places] = 1.0, 1.0
    return draws._replace(theta=theta, point=point)
