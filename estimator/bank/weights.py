"""Weights of the members, horizon by horizon, from what their forecasts have cost so far.

The weight of member e at a horizon is proportional to exp(-r n (L_e - L_b) / L_b): L_e its mean loss, discounted over
time, L_b that of the best member, n the number of hours that the losses stand for and r the learning rate. This is
exponentially weighted aggregation of probabilistic forecasts by their CRPS (Berrisch and Ziel 2021). With the best
member's loss as the unit it is quick where members differ by much, and slow where they hardly differ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.bank.options import BankOptions


class Losses(NamedTuple):
    """Discounted sums over E members and H horizons, the first of which is one step."""

    loss: Array
    """(E, H): of the CRPS [K]."""
    hours: Array
    """(E, H): of the hours that they stand for."""


def no_losses(members: int, horizons: int) -> Losses:
    """Nothing has been verified."""
    return Losses(np.zeros((members, horizons)), np.zeros((members, horizons)))


def with_loss(losses: Losses, horizon: int, scores: Array, hours: float, options: BankOptions) -> Losses:
    """`losses` after a forecast `horizon` ahead that cost each member `scores` (E,) [K]; NaN: no forecast of it."""
    kept = options.discount**hours
    known = np.isfinite(scores)
    loss, total = losses.loss.copy(), losses.hours.copy()
    loss[known, horizon] = kept * loss[known, horizon] + hours * scores[known]
    total[known, horizon] = kept * total[known, horizon] + hours
    return Losses(loss, total)


def weights(losses: Losses, options: BankOptions) -> Array:
    """Weights (E, H) of the members; equal at a horizon of which nothing has been verified."""
    hours = losses.hours
    mean = losses.loss / np.maximum(hours, 1e-12)
    known = hours > 0.0
    mean = np.where(known, mean, np.where(known, mean, -np.inf).max(axis=0, keepdims=True))
    best = np.where(known, mean, np.inf).min(axis=0, keepdims=True)
    unit = np.where(np.isfinite(best), np.maximum(best, 1e-9), 1.0)
    excess = np.where(np.isfinite(mean), (mean - best) / unit, 0.0)
    trust = np.minimum(options.learning_rate * hours.max(axis=0, keepdims=True), options.most_trust)
    raw = np.exp(-trust * np.maximum(excess, 0.0))
    normalised: Array = raw / raw.sum(axis=0, keepdims=True)
    return normalised


def between(values: Array, leads: tuple[int, ...], lead: int) -> Array:
    """`values` (..., H), given at `leads`, at another `lead`: linear in its logarithm, constant beyond the ends."""
    place = np.interp(np.log(max(lead, 1)), np.log(np.array(leads, dtype=np.float64)), np.arange(len(leads)))
    low = int(place)
    share = place - low
    mixed: Array = values[..., low] * (1.0 - share) + (values[..., min(low + 1, len(leads) - 1)] * share)
    return mixed
