"""Recorded periods as CSV files: the same table gives the same bytes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array


def cells(values: Array, decimals: int) -> list[str]:
    """Numbers (K,) as text with fixed decimals; NaN becomes an empty cell."""
    rounded = np.round(values, decimals) + 0.0  # the sum turns -0.0 into 0.0
    return [f"{value:.{decimals}f}" if value == value else "" for value in rounded.tolist()]


def local_stamps(seconds: npt.NDArray[np.int64]) -> list[str]:
    """Wall-clock seconds (K,) as naive "YYYY-MM-DD hh:mm:ss"."""
    return [stamp.replace("T", " ") for stamp in np.datetime_as_string(seconds.astype("datetime64[s]")).tolist()]


def utc_stamps(times: npt.NDArray[np.int64]) -> list[str]:
    """UTC seconds (K,) as RFC 3339 with Z."""
    return [f"{stamp}Z" for stamp in np.datetime_as_string(times.astype("datetime64[s]")).tolist()]


def write_table(path: Path, columns: Mapping[str, Sequence[str]]) -> Path:
    """Write equally long `columns` of cells under their names. Returns `path`."""
    lines = [",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]
    path.write_bytes("".join(f"{line}\n" for line in lines).encode("utf-8"))
    return path
