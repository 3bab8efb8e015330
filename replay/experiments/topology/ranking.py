"""Which of the fitted candidates to take: the simplest of those that are about as accurate as the best."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.experiments.study import Figures
from replay.experiments.topology.candidates import Candidate
from replay.experiments.topology.fit import HELD_OUT, NIGHTLY, TRAIN, at_bound, fitted

COMPARABLE = 0.05
"""Errors that differ by no more than this share of them do not pay for another node (the paper's "comparable")."""


class Fitted(NamedTuple):
    """A candidate and the figures of its fit."""

    candidate: Candidate
    found: Figures
    loss: float = np.nan
    """By how much, as a share and on geometric average, its criteria exceed the best candidate's in each."""

    @property
    def theta(self) -> Array:
        """(n_theta,)."""
        return np.array([self.found[fitted(one.name)] for one in self.candidate.network.parameters])

    @property
    def at_bound(self) -> list[str]:
        return [one.name for one in self.candidate.network.parameters if self.found.get(at_bound(one.name))]

    @property
    def complexity(self) -> tuple[int, int, int]:
        """Free parameters, those of them that the data do not determine, and states."""
        return len(self.candidate.network.free), len(self.at_bound), len(self.candidate.network.nodes)

    def __str__(self) -> str:
        return f"{self.complexity[2]} states and {self.complexity[0]} free parameters"


def rank(entries: Sequence[Fitted]) -> list[Fitted]:
    """`entries` with their losses, the one to take first, the others by loss: the mean of train RMSE, night MAE and
    held-out RMSE, as far as there are any, not the worst, for a held-out part of a few days is a matter of luck. Taken
    is the simplest candidate within COMPARABLE of the smallest loss."""
    table = np.array([[entry.found[name] for name in (TRAIN, NIGHTLY, HELD_OUT)] for entry in entries])
    table = np.maximum(table[:, np.isfinite(table).all(axis=0)], 1e-6)
    losses = np.exp(np.log(table / table.min(axis=0)).mean(axis=1)) - 1.0
    ranked = [entry._replace(loss=float(loss)) for entry, loss in zip(entries, losses, strict=True)]
    ranked.sort(key=lambda entry: entry.loss)
    comparable = [entry for entry in ranked if entry.loss <= ranked[0].loss + COMPARABLE]
    taken = min(comparable, key=lambda entry: (entry.complexity, entry.loss))
    return [taken, *(entry for entry in ranked if entry is not taken)]
