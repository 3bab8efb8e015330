"""Cells of a recorded table as compact arrays: a value and a status code for each."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adapters.reading import Fault

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.uint8]

MISSING_WORDS = frozenset({"", "na", "n/a", "null", "none", "-"})
"""What counts as a missing cell, in any case and with blanks around it. "nan" is not among them: it is a value that
is not finite, and counted as such."""


class Status(IntEnum):
    """What is to be made of a cell. Where several cells make one value, the highest code speaks for all."""

    GOOD = 0
    MISSING = 1
    NON_NUMERIC = 2
    NOT_FINITE = 3
    OUT_OF_RANGE = 4
    NAIVE_TIMESTAMP = 5
    BAD_TIMESTAMP = 6


FAULTS: dict[int, Fault] = {status: Fault[status.name] for status in Status if status > Status.MISSING}


class Cells(NamedTuple):
    """Parallel arrays of shape (n,): values (NaN unless good) and `Status` codes."""

    values: Array
    status: Codes


def parse_numbers(cells: Sequence[str], decimal: str) -> Cells:
    """Numbers out of text cells with `decimal` ("." or ",") as decimal mark. Refused are a point beside a decimal
    comma, for "1.234" is a thousand to its writer, and Python's digit separators ("1_000")."""
    foreign = "_" if decimal == "." else "_."
    text = "".join(cells)
    if not any(mark in text for mark in foreign):
        try:
            values = np.array([float(cell.replace(decimal, ".")) for cell in cells], dtype=np.float64)
        except ValueError:
            pass
        else:
            return _finite(values)
    numbers, status = np.full(len(cells), np.nan), np.zeros(len(cells), dtype=np.uint8)
    for i, cell in enumerate(cells):
        numbers[i], status[i] = _number(cell, decimal, foreign)
    return Cells(numbers, status)


def _finite(values: Array) -> Cells:
    finite = np.isfinite(values)
    return Cells(np.where(finite, values, np.nan), np.where(finite, 0, Status.NOT_FINITE).astype(np.uint8))


def _number(cell: str, decimal: str, foreign: str) -> tuple[float, Status]:
    if cell.strip().lower() in MISSING_WORDS:
        return np.nan, Status.MISSING
    if any(mark in cell for mark in foreign):
        return np.nan, Status.NON_NUMERIC
    try:
        value = float(cell.replace(decimal, "."))
    except ValueError:
        return np.nan, Status.NON_NUMERIC
    return (value, Status.GOOD) if np.isfinite(value) else (np.nan, Status.NOT_FINITE)


def sum_cells(columns: Sequence[Cells]) -> Cells:
    """The sum over columns, row by row; missing where one is missing, faulty where one is faulty."""
    status = np.maximum.reduce([column.status for column in columns])
    with np.errstate(over="ignore", invalid="ignore"):
        values = np.add.reduce([column.values for column in columns])
    return Cells(values, status)


def convert(cells: Cells, steps: Sequence[tuple[float, float]], valid: tuple[float, float]) -> Cells:
    """Apply the affine `steps` (scale, offset) in order, then refuse what lies outside `valid`."""
    values, status = cells.values, cells.status.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for scale, offset in steps:
            values = values * scale + offset
        good = status == Status.GOOD
        status[good & ~np.isfinite(values)] = Status.NOT_FINITE
        status[good & np.isfinite(values) & ((values < valid[0]) | (values > valid[1]))] = Status.OUT_OF_RANGE
    return Cells(np.where(status == Status.GOOD, values, np.nan), status)
