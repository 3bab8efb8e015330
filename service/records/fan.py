"""A forecast over several steps, as columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from service.records.outlook import InputOrigin
from service.records.update import Update

Array = npt.NDArray[np.float64]


class FanColumns(NamedTuple):
    """The forecast of one output over h + 1 steps [degC, K], the sensor's noise included."""

    output: str
    mean: Array
    """(h + 1,), as `median` and `sd`."""
    median: Array
    sd: Array
    lower: Array
    """(L, h + 1): the bounds of the intervals, by level."""
    upper: Array


class Fan(NamedTuple):
    """The forecast of one zone: the first entry of every column is the published one-step forecast of `update`, and
    each of the others is one period later."""

    update: Update
    levels: tuple[float, ...]
    """(L,): of the intervals."""
    outputs: tuple[FanColumns, ...]
    paths: Array
    """(K, h + 1, n_y): sampled futures [degC] without the sensor's noise; K is 0 where none were asked for."""
    origins: tuple[InputOrigin, ...]
    """Where the inputs of the later steps come from."""
