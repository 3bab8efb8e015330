"""The timestamp column of a recorded file."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple
from zoneinfo import ZoneInfo

import numpy as np
import numpy.typing as npt

from adapters.csv.cells import Array, Cells, Status
from adapters.timestamps import EARLIEST, LATEST, Parser, local_to_utc

_DAY = 86400.0


class Moments(NamedTuple):
    """Timestamps (n,): `seconds` since 1970 in UTC, or wall-clock time where `naive`; NaN if not parsed."""

    seconds: Array
    naive: npt.NDArray[np.bool_]


class Chunk(NamedTuple):
    """Some rows of a file, (n,): when they are, and the cells of each column by name."""

    moments: Moments
    cells: Mapping[str, Cells]


def parse_timestamps(cells: Sequence[str], parser: Parser) -> Moments:
    """Parse every cell; one that is no timestamp becomes NaN."""
    seconds, naive = np.full(len(cells), np.nan), np.zeros(len(cells), dtype=np.bool_)
    for i, cell in enumerate(cells):
        try:
            seconds[i], naive[i] = parser(cell.strip())
        except (ValueError, OverflowError):
            continue
    return Moments(seconds, naive)


def to_utc(moments: Moments, zone: ZoneInfo | None) -> Cells:
    """UTC seconds of the timestamps of one file, in file order, with status GOOD, NAIVE_TIMESTAMP or BAD_TIMESTAMP."""
    times = moments.seconds.copy()
    plausible = (times >= EARLIEST - _DAY) & (times < LATEST + _DAY)
    local = moments.naive & plausible
    if zone is not None:
        times[local] = local_to_utc(times[local], zone)
    status = np.zeros(times.size, dtype=np.uint8)
    status[~((times >= EARLIEST) & (times < LATEST))] = Status.BAD_TIMESTAMP
    if zone is None:
        status[local] = Status.NAIVE_TIMESTAMP
    times[status != Status.GOOD] = np.nan
    return Cells(times, status)
