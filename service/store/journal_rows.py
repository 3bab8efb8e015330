"""Rows of the journal, and the checksums that tell damage, for SQLite does not notice a flipped bit in a value. The row
of a sample ends with a link, the CRC-32 over the row that is begun with the link of the sample before it: neither a
changed row nor a missing one in the middle passes. A history row has a CRC-32 of its own. Set-point and gain enter a
checksum only where they have a value."""

import logging
import math
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from adapters.reading import Quality, Reading
from estimator.arrays import Array, Indices
from service.records.history import HISTORY_COLUMNS, HistoryRow
from service.records.record import values
from service.records.sample import Sample

Accepted = tuple[str, int, bytes, bytes, str, str, float | None]
"""zone, time, outputs, inputs, output_quality, input_quality, setpoint."""

SampleRow = tuple[str, int, bytes, bytes, str, str, float | None, int]
"""The same, and link."""

ReadingRow = tuple[str, float, str, float, str, int]
"""zone, time, channel, value, quality, checksum."""

_log = logging.getLogger(__name__)

_FIRST = HISTORY_COLUMNS.index("gain_lower")
"""How many columns enter every checksum."""
_NUMBERS = struct.Struct(f"<{_FIRST}d")
_MORE = struct.Struct(f"<{len(HISTORY_COLUMNS) - _FIRST}d")
_SETPOINT = struct.Struct("<d")


def link_of(previous: int, row: Accepted) -> int:
    """The link of a sample's row after a sample with the link `previous`."""
    zone, time, outputs, inputs, output_quality, input_quality, setpoint = row
    words = f"{zone}\0{time}\0{output_quality}\0{input_quality}\0{len(outputs)}\0".encode()
    link = zlib.crc32(inputs, zlib.crc32(outputs, zlib.crc32(words, previous)))
    return link if setpoint is None else zlib.crc32(_SETPOINT.pack(setpoint), link)


def sample_row(zone: str, sample: Sample, previous: int) -> SampleRow:
    """The row of `sample` after a sample with the link `previous`."""
    row = (
        zone,
        sample.time,
        _to_blob(sample.outputs),
        _to_blob(sample.inputs),
        ",".join(sample.output_quality),
        ",".join(sample.input_quality),
        # SQLite keeps neither NaN nor the sign of zero.
        None if math.isnan(sample.setpoint) else float(sample.setpoint) + 0.0,
    )
    return (*row, link_of(previous, row))


def linked_sample(row: Accepted, link: int | None, previous: int) -> Sample:
    """The sample of a row with `link` after one with `previous`; ValueError, TypeError, struct.error if damaged."""
    if link != link_of(previous, row):
        raise ValueError("it does not match its checksum, or the one before it is missing")
    outputs, inputs = (np.frombuffer(blob, dtype="<f8").astype(np.float64) for blob in row[2:4])
    setpoint = math.nan if row[6] is None else float(row[6])
    return Sample(row[1], outputs, inputs, _qualities(row[4]), _qualities(row[5]), setpoint)


def history_row(zone: str, row: HistoryRow) -> tuple[object, ...]:
    """The columns of `row` with zone and checksum."""
    cells = [None if value != value else float(value) for value in values(row)]
    return (zone, *cells, history_checksum(zone, cells))


def history_checksum(zone: str, cells: Sequence[float | None]) -> int:
    """The CRC-32 of the columns of a history row as a database gives them back: SQLite keeps neither the sign of zero
    nor the kind of NaN. TypeError, OverflowError or struct.error where one is no number."""
    numbers = [math.nan if value is None or value != value else value + 0.0 for value in cells]
    checksum = zlib.crc32(_NUMBERS.pack(*numbers[:_FIRST]), zlib.crc32(zone.encode()))
    more = numbers[_FIRST:]
    return checksum if all(map(math.isnan, more)) else zlib.crc32(_MORE.pack(*more), checksum)


def reading_row(zone: str, reading: Reading) -> ReadingRow:
    """The row of a reading that is usable."""
    # SQLite does not keep the sign of zero.
    row = (zone, float(reading.time) + 0.0, reading.channel, float(reading.value) + 0.0, str(reading.quality))
    return (*row, _reading_checksum(*row))


def to_reading(row: ReadingRow) -> Reading:
    """The reading of a row; ValueError or TypeError if it does not match its checksum."""
    zone, time, channel, value, quality, checksum = row
    if checksum != _reading_checksum(zone, float(time), channel, float(value), quality):
        raise ValueError("it does not match its checksum")
    return Reading(channel, float(time), float(value), Quality(quality))


def _reading_checksum(zone: str, time: float, channel: str, value: float, quality: str) -> int:
    return zlib.crc32(struct.pack("<2d", time, value), zlib.crc32(f"{zone}\0{channel}\0{quality}".encode()))


class HistoryReader:
    """History rows of the journal at `place`, as far as they are sound; the log says once of each that is not."""

    def __init__(self, place: str) -> None:
        self._place = place
        self._told: set[tuple[str, int]] = set()

    def rows(self, zone: str, rows: Iterable[Sequence[Any]]) -> list[HistoryRow]:
        """The history rows of their columns, with the checksum last."""
        found = []
        for row in self._sound(zone, rows):
            cells: dict[str, Any] = {
                name: math.nan if cell is None else cell for name, cell in zip(HISTORY_COLUMNS, row[:-1], strict=True)
            }
            found.append(HistoryRow(**(cells | {"resampled": bool(cells["resampled"])})))
        return found

    def table(self, zone: str, rows: Iterable[Sequence[Any]]) -> tuple[Indices, Array]:
        """The same as times (n,), and all columns (n, m)."""
        sound = [row[:-1] for row in self._sound(zone, rows)]
        table = np.array(sound, dtype=np.float64).reshape(len(sound), len(HISTORY_COLUMNS))
        return table[:, 0].astype(np.int64), table

    def _sound(self, zone: str, rows: Iterable[Sequence[Any]]) -> Iterator[Sequence[Any]]:
        for row in rows:
            sound = False
            with suppress(TypeError, OverflowError, struct.error):
                sound = isinstance(row[0], int) and row[-1] == history_checksum(zone, row[:-1])
            if sound:
                yield row
            elif (zone, row[0]) not in self._told:
                self._told.add((zone, row[0]))
                _log.error("%s holds a damaged history row of zone '%s' at %s", self._place, zone, row[0])


def _to_blob(values: Array) -> bytes:
    return np.asarray(values, dtype="<f8").tobytes()


def _qualities(text: str) -> tuple[Quality, ...]:
    return tuple(Quality(word) for word in text.split(",")) if text else ()
