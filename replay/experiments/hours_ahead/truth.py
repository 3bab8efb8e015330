"""What an estimator has learned of a building, against what its simulator knows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.experiments.hours_ahead.recordings import Known
from replay.experiments.jobs import Arrays
from replay.localtime import DAY, HOUR, Seconds
from replay.scores.learning import area_under_roc

LEARNING = 21 * DAY
"""Time [s] after which what was learned is scored."""
ON = 150.0
"""W: a gain beyond this, in either direction, is one that acts; appliances on standby are not."""


class Learned(NamedTuple):
    """What was known after LEARNING; NaN where it was not known, or the recording is shorter.

    The error of the gain is its rms over the rms of the true gain: at every step (`gain_error`), as means over an hour
    (`hourly_error`), and at the steps without sun (`dark_error`), where no aperture can be wrong. `gain_coverage` is
    the share of true gains in the 95 % interval, and `on` the area under the ROC curve of the probability that a gain
    is on.
    """

    days: Array
    """(D,): days since the beginning."""
    by_day: Array
    """(D,): heat loss to outdoors [W/K] then."""
    heat_loss: float
    """That at the end of LEARNING over the true one."""
    gain_error: float
    hourly_error: float
    dark_error: float
    gain_coverage: float
    on: float


def learned(known: Known, times: Seconds, arrays: Arrays) -> Learned:
    """What a run with `arrays` (see `hours_job`) over samples at `times` (K,) has learned of what is `known`."""
    since = times - times[0]
    later = since >= LEARNING
    dark = later & known.dark
    gain, truth = arrays["gain"][later], known.gain[later]
    lower, middle, upper = gain.T
    days = since[arrays["heat_loss_rows"]]
    reached = arrays["heat_loss"][days >= LEARNING]
    an_hour = max(1, round(HOUR / float(times[1] - times[0])))
    inside = (lower <= truth) & (truth <= upper)
    return Learned(
        days / DAY,
        arrays["heat_loss"],
        float(reached[0]) / known.heat_loss if len(reached) else np.nan,
        _relative_error(middle, truth),
        _relative_error(_means(middle, an_hour), _means(truth, an_hour)),
        _relative_error(arrays["gain"][dark, 1], known.gain[dark]),
        float(inside.mean()) if later.any() and np.isfinite(middle).all() else np.nan,
        area_under_roc(arrays["on"][later], np.abs(truth) > ON) if later.any() else np.nan,
    )


def _relative_error(found: Array, truth: Array) -> float:
    """Root mean square of the error over that of the truth; NaN where anything is missing."""
    return float(np.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2))) if len(found) else np.nan


def _means(values: Array, count: int) -> Array:
    """Means of `count` values each; what is left over at the end counts for nothing."""
    return np.asarray(values[: len(values) // count * count].reshape(-1, count).mean(axis=1))
