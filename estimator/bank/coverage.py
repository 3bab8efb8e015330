"""The width of what is published, kept so that its interval covers as often as it claims.

Adaptive conformal inference (Gibbs and Candes 2021): at every verified forecast the log of the published spread over
that of the mixture grows where the interval missed, and shrinks a little where it did not. In the long run this holds
whatever the members do. The steps are larger while few forecasts have been verified, for a wrong spread is then likely.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array

_WIDEST = 5.0
"""Bound of the log of the published spread over that of the mixture."""


class Widths(NamedTuple):
    """H horizons."""

    log_scale: Array
    """(H,): log of the published spread over that of the mixture."""
    verified: Array
    """(H,): how many forecasts have been verified."""


def no_widths(horizons: int) -> Widths:
    """The mixture as it is."""
    return Widths(np.zeros(horizons), np.zeros(horizons))


def with_place(widths: Widths, horizon: int, place: float, level: float, feedback: float, first: float) -> Widths:
    """`widths` after a sample at `place` of the published distribution, a probability, `horizon` ahead.

    `level` is that of the interval; the step of the log scale is `feedback`, or `first` over the number of verified
    forecasts where that is more.
    """
    log_scale, verified = widths.log_scale.copy(), widths.verified.copy()
    verified[horizon] += 1.0
    missed = float(abs(place - 0.5) > 0.5 * level)
    step = max(feedback, first / verified[horizon])
    moved = log_scale[horizon] + step * (missed - (1.0 - level))
    log_scale[horizon] = min(max(moved, -_WIDEST), _WIDEST)
    return Widths(log_scale, verified)
