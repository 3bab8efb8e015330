"""Recorded periods as CSV files: the same table gives the same bytes, gzipped or not."""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array


def cells(values: Array, decimals: int, mark: str = ".") -> list[str]:
    """Numbers (K,) as text with fixed decimals and decimal `mark`; NaN becomes an empty cell."""
    rounded = np.round(values, decimals) + 0.0  # the sum turns -0.0 into 0.0
    text = [f"{value:.{decimals}f}" if value == value else "" for value in rounded.tolist()]
    return text if mark == "." else [cell.replace(".", mark) for cell in text]


def local_stamps(seconds: npt.NDArray[np.int64]) -> list[str]:
    """Wall-clock seconds (K,) as naive "YYYY-MM-DD hh:mm:ss"."""
    return [stamp.replace("T", " ") for stamp in np.datetime_as_string(seconds.astype("datetime64[s]")).tolist()]


def utc_stamps(times: npt.NDArray[np.int64]) -> list[str]:
    """UTC seconds (K,) as RFC 3339 with Z."""
    return [f"{stamp}Z" for stamp in np.datetime_as_string(times.astype("datetime64[s]")).tolist()]


def write_table(path: Path, header: Iterable[str], columns: Sequence[Sequence[str]], delimiter: str = ",") -> Path:
    """Write equally long `columns` of cells under `header`; gzipped where the name ends in .gz. Returns `path`."""
    lines = [delimiter.join(header), *map(delimiter.join, zip(*columns, strict=True))]
    data = "".join(f"{line}\n" for line in lines).encode("utf-8")
    # No modification time in the gzip header: the file depends on its content alone.
    path.write_bytes(gzip.compress(data, mtime=0) if path.suffix == ".gz" else data)
    return path
