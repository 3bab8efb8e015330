"""The running record of a zone: daily sums of its indoor temperature and inputs, and the largest inputs so far.

Its size is bounded and does not grow: the energy balance needs sums over the last weeks, and no samples.
"""

from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array

DAYS = 28
"""Days that the record reaches back: four whole weeks, in which a heavy building has forgotten where it started."""


class Record(NamedTuple):
    """Sums over the last D = DAYS days of UTC; day d is in row d modulo D."""

    days: Array
    """(D,): days since 1970 that the rows stand for; -1 for an empty row."""
    seconds: Array
    """(D,): seconds with a measured indoor temperature."""
    output: Array
    """(D,): sums of the first output over these seconds [degC s]."""
    inputs: Array
    """(D, n_u): sums of every input over the same seconds [K s, J, J/m2]."""
    largest: Array
    """(n_u,): largest value that each input has had, at least 0."""


def no_record(inputs: int) -> Record:
    """The record of a zone with `inputs` inputs that has seen nothing."""
    return Record(np.full(DAYS, -1.0), np.zeros(DAYS), np.zeros(DAYS), np.zeros((DAYS, inputs)), np.zeros(inputs))


def with_sample(record: Record, time: float, period: float, output: float, inputs: Array) -> Record:
    """`record` after the sample at `time` [UTC s] that stands for `period` s: its first output [degC], NaN if missing,
    and the inputs (n_u,) in force."""
    largest = np.fmax(record.largest, inputs)
    if not np.isfinite(output) or not np.isfinite(inputs).all():
        return record._replace(largest=largest)
    day = time // DAY
    row = int(day) % DAYS
    days, seconds, outputs, sums = (values.copy() for values in record[:4])
    if days[row] != day:
        days[row], seconds[row], outputs[row], sums[row] = day, 0.0, 0.0, 0.0
    seconds[row] += period
    outputs[row] += period * output
    sums[row] += period * inputs
    return Record(days, seconds, outputs, sums, largest)


def recorded_days(record: Record) -> float:
    """Days with measurements in the record, at most DAYS."""
    return float(record.seconds.sum() / DAY)
