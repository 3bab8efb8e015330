"""One recorded CSV file as a table of channels over UTC time."""

import codecs
import csv
import gzip
import io
import re
import zlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from math import inf
from pathlib import Path
from typing import NamedTuple, TextIO, TypeVar
from zoneinfo import ZoneInfo

import numpy as np

from adapters.csv.cells import Array, Cells, Codes, Status, convert, parse_numbers, sum_cells
from adapters.csv.config import LayoutConfig
from adapters.csv.parquet import is_parquet, parquet_chunks, parquet_columns
from adapters.csv.times import Chunk, Moments, parse_timestamps, to_utc
from adapters.edge import PLAIN, Edge
from adapters.errors import SourceConfigError, SourceError, SourceUnavailable
from adapters.timestamps import timestamp_parser

# Reading a chunk holds the interpreter lock for a few milliseconds: little enough for the event loop beside it.
_CHUNK_ROWS = 4096

_LONGEST_LINE = 2**20
"""Characters; a file without any end of line would be read into memory whole."""

_LONGEST_CELL = 20
"""Lines that a cell in quotes may go over."""


_Arrays = TypeVar("_Arrays", Cells, Moments)


@dataclass(frozen=True)
class CsvChannel:
    """How columns become the readings of channel `id` ("zone/channel"): their sum is the raw value for `edge`."""

    id: str
    columns: tuple[str, ...]
    edge: Edge = PLAIN


class Table(NamedTuple):
    """The rows of one file in the order of time: `order` (n,) is UTC s, never falling; `times` (n,) the same, but NaN
    where a timestamp was refused, such a row standing with the one before it. `values` and `status` are (n_channels,
    n), values in the network's unit, but raw of a counter."""

    order: Array
    times: Array
    values: Array
    status: Codes


def read_header(path: Path, layout: LayoutConfig) -> list[str]:
    """Column names of a file; SourceError if there are none to be had."""
    if is_parquet(path):
        _refuse_pipe(path)
        return list(parquet_columns(path))
    with _opened(path, layout) as reader:
        return _header(path, reader)


def column_problems(
    path: Path, header: Sequence[str], channels: Sequence[CsvChannel], layout: LayoutConfig
) -> list[str]:
    """One sentence for every column that is bound but not in the header, or in it more than once."""
    users = {layout.timestamp.column: "the timestamp"}
    for channel in channels:
        for column in channel.columns:
            users.setdefault(column, f"channel {channel.id}")
    problems = []
    for column, user in users.items():
        if header.count(column) > 1:
            problems.append(
                f"file '{path}' has the column {_called(column)} ({user}) more than once; rename all but one"
            )
        elif column not in header:
            names = ", ".join(name or "(unnamed)" for name in header)
            hint = f"; is the delimiter '{layout.delimiter}'?" if len(header) == 1 else ""
            problems.append(f"file '{path}' has no column {_called(column)} ({user}); its columns are: {names}{hint}")
    return problems


def _called(column: str) -> str:
    return f"'{column}'" if column else "without a name"


def read_table(
    path: Path,
    channels: Sequence[CsvChannel],
    layout: LayoutConfig,
    stopped: Callable[[], bool] = lambda: False,
    content: bytes | None = None,
) -> Table:
    """Read a whole file, or `content` as if it stood there, until `stopped` turns true. Raises SourceUnavailable if it
    cannot be read, SourceConfigError if a column is missing."""
    chunks = []
    for chunk in _chunks(path, channels, layout, content):
        if stopped():
            break
        chunks.append(chunk)
    if not chunks:
        return Table(
            np.empty(0), np.empty(0), np.empty((len(channels), 0)), np.empty((len(channels), 0), dtype=np.uint8)
        )
    zone = None if layout.timestamp.zone is None else ZoneInfo(layout.timestamp.zone)
    times, refused = to_utc(_joined([chunk.moments for chunk in chunks]), zone)
    values = np.empty((len(channels), times.size))
    status = np.empty((len(channels), times.size), dtype=np.uint8)
    for i, channel in enumerate(channels):
        edge = channel.edge
        raw = sum_cells([_joined([chunk.cells[name] for chunk in chunks]) for name in channel.columns])
        steps = () if edge.counter else ((edge.scale, edge.offset), edge.conversion)
        values[i], status[i] = convert(raw, steps, (-inf, inf) if edge.counter else edge.valid)
    bad = refused != Status.GOOD
    values[:, bad] = np.nan
    status[:, bad] = refused[bad]
    order = _filled(times)
    rows = np.argsort(order, kind="stable") if np.any(order[1:] < order[:-1]) else slice(None)
    return Table(order[rows], times[rows], values[:, rows], status[:, rows])


def _joined(parts: Sequence[_Arrays]) -> _Arrays:
    return type(parts[0])(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _chunks(path: Path, channels: Sequence[CsvChannel], layout: LayoutConfig, content: bytes | None) -> Iterator[Chunk]:
    """The rows of a file with the columns that `channels` need; SourceConfigError if one is missing."""
    time, parser = layout.timestamp.column, timestamp_parser(layout.timestamp.format)
    wanted = dict.fromkeys(name for channel in channels for name in channel.columns)
    if is_parquet(path):
        _require(path, read_header(path, layout), channels, layout)
        yield from parquet_chunks(path, time, parser, wanted, layout.decimal, _CHUNK_ROWS)
        return
    with _opened(path, layout, content) as reader:
        header = _header(path, reader)
        _require(path, header, channels, layout)
        position = {name: i for i, name in enumerate(header)}
        while rows := list(islice(reader, _CHUNK_ROWS)):
            rows = [row for row in rows if row]
            cells = {name: parse_numbers(_column(rows, position[name]), layout.decimal) for name in wanted}
            yield Chunk(parse_timestamps(_column(rows, position[time]), parser), cells)


def _require(path: Path, header: Sequence[str], channels: Sequence[CsvChannel], layout: LayoutConfig) -> None:
    problems = column_problems(path, header, channels, layout)
    if problems:
        raise SourceConfigError("; ".join(problems))


def _filled(times: Array) -> Array:
    """`times` with each NaN replaced by the time before it, at the head by the first; -inf if there is none at all."""
    known = np.isfinite(times)
    if not known.any():
        return np.full(times.size, -inf)
    nearest = np.maximum.accumulate(np.where(known, np.arange(times.size), -1))
    nearest[nearest < 0] = known.argmax()
    return times[nearest]


def _column(rows: Sequence[Sequence[str]], position: int) -> list[str]:
    try:
        return [row[position] for row in rows]
    except IndexError:
        return [row[position] if position < len(row) else "" for row in rows]


def _refuse_pipe(path: Path) -> None:
    """SourceUnavailable for a pipe or a device, which would be waited for."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise SourceUnavailable(f"file '{path}' is a pipe or a device; give a file")


CsvReader = Iterator[list[str]]


@contextmanager
def _opened(path: Path, layout: LayoutConfig, content: bytes | None = None) -> Iterator[CsvReader]:
    """A CSV reader over the file, or over `content`; whatever reading it may raise becomes a SourceUnavailable."""
    # A byte-order mark would otherwise end up in the name of the first column.
    utf8 = codecs.lookup(layout.encoding).name == "utf-8"
    encoding = "utf-8-sig" if utf8 else layout.encoding
    if content is None:
        _refuse_pipe(path)
    try:
        with path.open("rb") if content is None else io.BytesIO(content) as raw:
            binary = gzip.GzipFile(fileobj=raw) if path.suffix.lower() == ".gz" else raw
            # A damaged byte spoils its own cell, which is then counted as non-numeric, and not the whole file.
            text = io.TextIOWrapper(binary, encoding=encoding, errors="replace", newline="")
            yield csv.reader(
                _lines(path, text, layout.delimiter),
                delimiter=layout.delimiter,
                skipinitialspace=layout.delimiter != " ",
            )
    except SourceError:
        raise
    except csv.Error as error:
        raise SourceUnavailable(f"file '{path}' is no CSV ({error}); look for a quote that is not closed") from error
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise SourceUnavailable(f"file '{path}' is no complete gzip file ({error}); copy it again") from error
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SourceUnavailable(f"file '{path}' cannot be read ({reason}); check its path and permissions") from error


def _lines(path: Path, text: TextIO, delimiter: str) -> Iterator[str]:
    """The lines of a file, such that a quote that is not closed spoils its own row and not those after it."""
    # A quote in the middle of a cell is an inch or a second.
    opening = re.compile(rf'(?:^|{re.escape(delimiter)})\s*"')
    ahead: deque[str] = deque()
    within = False
    """Whether a cell in quotes goes on into the line."""
    while line := ahead.popleft() if ahead else _line(path, text):
        if line.count('"') % 2:
            if within:
                within = False
            else:
                within = _is_closed(path, text, ahead)
                if not within and opening.search(line):
                    line = line.replace('"', "")
        yield line


def _is_closed(path: Path, text: TextIO, ahead: deque[str]) -> bool:
    """Whether a cell in quotes ends within the lines `ahead`, which are read as far as that takes."""
    for number in range(_LONGEST_CELL):
        if number == len(ahead):
            following = _line(path, text)
            if not following:
                return False
            ahead.append(following)
        if ahead[number].count('"') % 2:
            return True
    return False


def _line(path: Path, text: TextIO) -> str:
    """The next line, "" at the end."""
    line = text.readline(_LONGEST_LINE)
    if len(line) >= _LONGEST_LINE:
        raise SourceUnavailable(f"file '{path}' has a line of more than {_LONGEST_LINE} characters; is it CSV?")
    return line


def _header(path: Path, reader: CsvReader) -> list[str]:
    for row in reader:
        if row:
            return [name.strip() for name in row]
    raise SourceUnavailable(f"file '{path}' is empty; it needs a first line with the names of its columns")
