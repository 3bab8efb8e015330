"""Recorded telemetry from CSV files as a source of readings (paper 4.3.1: records ordered by timestamp)."""

import asyncio
from collections.abc import AsyncIterator, Iterator, Sequence
from itertools import pairwise
from math import inf, isfinite
from pathlib import Path

import numpy as np

from adapters.channel import Binding
from adapters.csv.cells import FAULTS, Status
from adapters.csv.config import CsvConfig
from adapters.csv.growing import GrowingFile
from adapters.csv.table import CsvChannel, Table, column_problems, read_header, read_table
from adapters.edge import Converter, looked_at
from adapters.errors import SourceError, SourceUnavailable, said_of
from adapters.playback import RecordedSource
from adapters.reading import Batch, Probe, Reading

# About a millisecond of work between two turns of the event loop.
_BATCH_READINGS = 2048

_LOOK_SECONDS = 0.2
"""Between two looks at a file that grows."""


class CsvSource(RecordedSource):
    """The CSV files of a table, one after the other, as fast as possible or at a pace.

    A last file that is followed has no end: what is appended to it is delivered as it comes.

    Within a file rows are ordered by timestamp; files are taken in the given order, so a later one should not begin
    before an earlier one ends. A file whose name ends in .gz is decompressed. Cells that are empty or hold "NA", "N/A",
    "null", "none" or "-" are missing: no reading. A sum over several columns is missing where one of them is.

    Timestamps without UTC offset are wall-clock time in the zone of the table; without a zone every one of them is a
    fault. A faulty cell or timestamp is delivered as a bad reading with its fault, so that it can be counted; a refused
    timestamp gives one for every channel.

    A batch covers the rows of one timestamp when paced, and more of them otherwise. As long as no timestamp could be
    read, the clock `now` of the batches is -inf.
    """

    def __init__(self, name: str, table: CsvConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, table, bindings)
        self._table, self._files = table, table.files
        self._channels = [CsvChannel(one.id, one.channel.source_columns, one.edge()) for one in bindings]

    def check(self) -> list[str]:
        problems: list[str] = []
        for path in self._files:
            try:
                header = read_header(path, self._table)
            except SourceError as error:
                problems.append(str(error))
            else:
                problems.extend(column_problems(path, header, self._channels, self._table))
        return [f"sources.{self.name}: {problem}" for problem in problems]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        converters = [Converter(*one) for one in self._edges]
        clock, self._origin = -inf, None
        async for table in self._tables():
            first = 0 if start is None else int(np.searchsorted(table.order, start))
            for begin, end in self._groups(table, first):
                clock = max(clock, float(table.order[end - 1]))
                if not await self._due(clock):
                    return
                yield Batch(self._readings(table, begin, end, converters), clock)

    async def _tables(self) -> AsyncIterator[Table]:
        """The files, and then, if the last one is followed, what is appended to it, until the source is closed."""
        for path in self._files[:-1] if self._table.follow else self._files:
            yield await self._read(path)
        growing = GrowingFile(self._files[-1])
        while self._table.follow and not self._closed:
            if (piece := await asyncio.to_thread(growing.piece)) is None:
                await asyncio.sleep(_LOOK_SECONDS)
            else:
                yield await self._read(self._files[-1], piece)

    async def _read(self, path: Path, content: bytes | None = None) -> Table:
        abandoned = False
        try:
            with said_of(self.name):
                return await asyncio.to_thread(
                    read_table, path, self._channels, self._table, lambda: self._closed or abandoned, content
                )
        finally:
            # A cancelled task leaves its thread behind; it must not go on reading for nobody and delay the exit.
            abandoned = True

    def _groups(self, table: Table, first: int) -> Iterator[tuple[int, int]]:
        """Row ranges (begin, end) of the batches: rows of one time when paced, a fixed number of them otherwise."""
        rows = table.order.size
        if self._pace == inf:
            size = max(1, _BATCH_READINGS // max(1, len(self._channels)))
            edges = [*range(first, rows, size), rows]
        else:
            later = table.order[first + 1 :] != table.order[first : rows - 1]
            edges = [first, *(np.flatnonzero(later) + first + 1).tolist(), rows]
        return ((begin, end) for begin, end in pairwise(edges) if begin < end)

    def _readings(self, table: Table, begin: int, end: int, converters: Sequence[Converter]) -> list[Reading]:
        times = table.times[begin:end].tolist()
        block, codes = table.values[:, begin:end].tolist(), table.status[:, begin:end]
        spoiled = (codes != Status.GOOD).any(axis=1).tolist()
        readings: list[Reading] = []
        for i, (channel, values) in enumerate(zip(self._channels, block, strict=True)):
            if not channel.edge.counter and not spoiled[i]:
                readings += [Reading(channel.id, time, value) for time, value in zip(times, values, strict=True)]
                continue
            for time, value, code in zip(times, values, codes[i].tolist(), strict=True):
                if code == Status.GOOD:
                    counter = channel.edge.counter
                    reading = converters[i].reading(time, value) if counter else Reading(channel.id, time, value)
                    # A counter's first row is no power yet.
                    if reading is not None:
                        readings.append(reading)
                elif code != Status.MISSING:
                    readings.append(converters[i].bad(time, FAULTS[code]))
        return readings

    async def probe(self, seconds: float) -> list[Probe]:
        first = await self._read(self._files[0])
        last = first if len(self._files) == 1 else await self._read(self._files[-1])
        for path, table in ((self._files[0], first), (self._files[-1], last)):
            if table.order.size == 0:
                raise SourceUnavailable(f"sources.{self.name}: file '{path}' has no rows; give one that has")
        return [
            _probe(channel, i, table, row)
            for i, channel in enumerate(self._channels)
            for table, row in ((first, 0), (last, -1))
        ]


def _probe(channel: CsvChannel, index: int, table: Table, row: int) -> Probe:
    code, when, value = int(table.status[index, row]), float(table.times[row]), float(table.values[index, row])
    place = f"{' + '.join(column or '(unnamed)' for column in channel.columns)}, {'first' if row == 0 else 'last'} row"
    time = when if isfinite(when) else None
    if code != Status.GOOD:
        return Probe(channel.id, place, "-", None, time, Status(code).name.lower().replace("_", " "))
    if channel.edge.counter:
        return looked_at(channel.id, place, channel.edge, value, time)
    return Probe(channel.id, place, "-", value, time)
