"""Parquet files, which have typed columns, as the chunks of a recorded file. pyarrow is an extra."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from adapters.csv.cells import Cells, Status, parse_numbers
from adapters.csv.times import Chunk, Moments, parse_timestamps
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.timestamps import Parser


def is_parquet(path: Path) -> bool:
    return path.suffix.lower() == ".parquet"


def parquet_columns(path: Path) -> dict[str, bool]:
    """The columns of a file, and whether each holds times; SourceError if it cannot be read."""
    with _opened(path) as (arrow, file):
        return {field.name: arrow.types.is_timestamp(field.type) for field in file.schema_arrow}


def parquet_chunks(
    path: Path, timestamp: str, parser: Parser, columns: Collection[str], decimal: str, rows: int
) -> Iterator[Chunk]:
    """`rows` rows at once of the time in column `timestamp`, which `parser` reads where it is no time stamp, and of the
    numbers in `columns`, which have the `decimal` mark where they are texts."""
    with _opened(path) as (arrow, file):
        for batch in file.iter_batches(rows, columns=list({timestamp, *columns})):
            yield Chunk(
                _moments(arrow, batch.column(timestamp), parser),
                {name: _cells(arrow, batch.column(name), decimal) for name in columns},
            )


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    try:
        import pyarrow
        from pyarrow.parquet import ParquetFile
    except ImportError:
        raise SourceConfigError(
            f"file '{path}' needs pyarrow, which is not installed; install it with: pip install \"thermogate[parquet]\""
        ) from None
    try:
        with ParquetFile(path) as file:
            yield pyarrow, file
    except pyarrow.ArrowException as error:
        said = str(error).splitlines()[0].rstrip(".")
        raise SourceUnavailable(f"file '{path}' is no Parquet file ({said}); write it again") from error
    except OSError as error:
        reason = error.strerror or error
        raise SourceUnavailable(f"file '{path}' cannot be read ({reason}); check its path and permissions") from error


def _moments(arrow: Any, column: Any, parser: Parser) -> Moments:
    if not arrow.types.is_timestamp(column.type):
        return parse_timestamps(["" if cell is None else str(cell) for cell in column.to_pylist()], parser)
    moments = column.cast(arrow.timestamp("us", column.type.tz), safe=False).cast(arrow.int64())
    seconds = np.asarray(moments.to_numpy(zero_copy_only=False), dtype=np.float64) / 1e6
    return Moments(seconds, np.full(len(seconds), column.type.tz is None))


def _cells(arrow: Any, column: Any, decimal: str) -> Cells:
    types = arrow.types
    if types.is_string(column.type) or types.is_large_string(column.type):
        return parse_numbers(["" if cell is None else cell for cell in column.to_pylist()], decimal)
    missing = column.is_null().to_numpy(zero_copy_only=False)
    number = types.is_floating(column.type) or types.is_integer(column.type)
    if not (number or types.is_decimal(column.type) or types.is_boolean(column.type)):
        values, wrong = np.full(len(column), np.nan), np.full(len(column), Status.NON_NUMERIC)
    else:
        column = column.cast(arrow.int8()) if types.is_boolean(column.type) else column
        values = np.array(column.cast(arrow.float64(), safe=False).to_numpy(zero_copy_only=False))
        wrong = np.where(np.isfinite(values), Status.GOOD, Status.NOT_FINITE)
    values[wrong != Status.GOOD] = np.nan
    return Cells(values, np.where(missing, Status.MISSING, wrong).astype(np.uint8))
