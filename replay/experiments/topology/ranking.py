"""Which of the fitted candidates to take: the simplest of those that are about as accurate as the best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from replay.experiments.topology.candidates import Candidate
from replay.experiments.topology.fit import TopologyScores

COMPARABLE = 0.05
"""Errors that differ by no more than this share of them do not pay for another node (the paper's "comparable")."""


class Fitted(NamedTuple):
    """A candidate and what its fit came to."""

    candidate: Candidate
    scores: TopologyScores
    at_bound: tuple[str, ...]
    loss: float = np.nan
    """By how much, as a share and on geometric average, its criteria exceed the best candidate's in each."""

    @property
    def complexity(self) -> tuple[int, int, int]:
        """Free parameters, those of them that the data do not determine, and states."""
        return len(self.candidate.network.free), len(self.at_bound), len(self.candidate.network.nodes)


def rank(fitted: Sequence[Fitted]) -> list[Fitted]:
    """`fitted` with their losses, the one to take first, the others by loss.

    The criteria are train RMSE, night MAE and held-out RMSE, as far as there are any; their average rather than their
    worst, for a held-out part of a few days is a matter of luck. To be taken, a candidate must be
    within COMPARABLE of the smallest loss; among those it is the simplest.
    """
    table = np.array([[f.scores.train_rmse, f.scores.night_mae, f.scores.held_out_rmse] for f in fitted])
    table = table[:, np.isfinite(table).all(axis=0)]
    table = np.maximum(table, 1e-6)
    losses = np.exp(np.log(table / table.min(axis=0)).mean(axis=1)) - 1.0
    ranked = sorted(
        (entry._replace(loss=float(loss)) for entry, loss in zip(fitted, losses, strict=True)),
        key=lambda entry: entry.loss,
    )
    comparable = [entry for entry in ranked if entry.loss <= ranked[0].loss + COMPARABLE]
    taken = min(comparable, key=lambda entry: (entry.complexity, entry.loss))
    return [taken, *(entry for entry in ranked if entry is not taken)]
