"""The width of what is published, kept so that its interval covers as often as it claims.

Adaptive conformal inference (Gibbs and Candes 2021): at every verified forecast the log of the published spread over
that of the mixture grows where the interval missed, and shrinks a little where it did not. In the long run this holds
whatever the members do. The steps are larger while few forecasts have been verified, for a wrong spread is then likely.
Forecasts that overlap miss together: each moves the spread as far as it is a forecast of its own, or one event would
widen what is published for weeks.

Whether an interval held says little about how much too wide it was. So the spread also follows its maximum likelihood,
recursively: with z the standard normal quantile at the probability of what came, z^2 is 1 on average where the spread
is right. Verified forecasts count here as far as they do not overlap, against a prior of _PRIOR that had it right.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from estimator.arrays import Array

_WIDEST = 5.0
"""Bound of the log of the published spread over that of the mixture."""

_PRIOR = 10.0
"""Independent forecasts that the spread of the mixture itself counts as."""

_FARTHEST = 9.0
"""Bound of z^2: an outlier says little about the spread."""


class Widths(NamedTuple):
    """H horizons."""

    log_scale: Array
    """(H,): log of the published spread over that of the mixture."""
    verified: Array
    """(H,): how many forecasts have been verified."""


def no_widths(horizons: int) -> Widths:
    """The mixture as it is."""
    return Widths(np.zeros(horizons), np.zeros(horizons))


def with_place(
    widths: Widths,
    horizon: int,
    place: float,
    share: float,
    *,
    level: float,
    feedback: float,
    first: float,
    stands: float = 1.0,
) -> Widths:
    """`widths` after a sample at `place` of the published distribution, a probability, `horizon` ahead.

    `share` is what the forecast counts as, in independent ones, 0 to 1. `level` is that of the interval; the step of
    the log scale is `feedback`, or `first` over the number of verified forecasts where that is more, times `share`. A
    forecast may stand for several that were not made.
    """
    log_scale, verified = widths.log_scale.copy(), widths.verified.copy()
    verified[horizon] += stands
    missed = float(abs(place - 0.5) > 0.5 * level)
    step = max(feedback, first / verified[horizon]) * share
    surprise = min(float(ndtri(place)) ** 2, _FARTHEST)
    likelihood = 0.5 * (surprise - 1.0) * share / (_PRIOR + share / stands * verified[horizon])
    moved = log_scale[horizon] + step * (missed - (1.0 - level)) + likelihood
    log_scale[horizon] = min(max(moved, -_WIDEST), _WIDEST)
    return Widths(log_scale, verified)
