"""A sample: one closed interval of a zone's grid."""

import math
from typing import NamedTuple, Self

from adapters.reading import Quality
from estimator.arrays import Array


class Sample(NamedTuple):
    """Grid interval [time, time + period) of a zone, closed and aggregated.

    `time` is UTC seconds; `outputs` (n_y,) and `inputs` (n_u,) follow the network's order, NaN where the interval
    had no usable reading; the qualities run parallel to them. `setpoint` (degC) is what the room was meant to have, NaN
    where nobody says; no estimator reads it.
    """

    time: int
    outputs: Array
    inputs: Array
    output_quality: tuple[Quality, ...]
    input_quality: tuple[Quality, ...]
    setpoint: float = math.nan

    @classmethod
    def measured(cls, time: int, outputs: Array, inputs: Array) -> Self:
        """A sample of which every reading is good."""
        good = (Quality.GOOD,)
        return cls(time, outputs, inputs, good * len(outputs), good * len(inputs))
