"""A stretch of a zone's history, thinned out for a chart."""

from typing import NamedTuple

from estimator.arrays import Array, Indices

GAIN = ("gain_lower", "gain_median", "gain_upper")
COLUMNS = ("y", "mean", "lower", "upper", "alpha_median", "gate", *GAIN, "setpoint")
"""Columns of the history that a chart shows."""
MAX_ROWS = 600_000
"""Rows that are read in all; of a longer stretch, only every second, third, ... sample is."""


class Series(NamedTuple):
    """n buckets of `bucket` s, oldest first; a bucket without any sample is left out.

    Temperatures are degC of the first output. `means` (n,) are by COLUMNS; `y_low`, `y_high`, `band_low` and
    `band_high` (n,) are the extremes of the measurement and of the published interval in each bucket, so that a
    thinned chart hides no peak. `inputs` (n, n_u) are means in the network's units. NaN where there was no value.
    """

    bucket: int
    times: Indices
    """(n,) UTC s, when each bucket begins."""
    means: dict[str, Array]
    y_low: Array
    y_high: Array
    band_low: Array
    band_high: Array
    inputs: Array


class Stretch(NamedTuple):
    """What is asked of a zone: [start, end) in UTC s, in buckets of whole periods (s), with `width` inputs."""

    zone: str
    start: int
    end: int
    period: int
    bucket: int
    width: int

    @property
    def stride(self) -> int:
        """Every which sample is read."""
        return max(1, -(-(self.end - self.start) // (self.period * MAX_ROWS)))
