"""Rows of the journal: what a sample and an update are in a database, and the checksums that tell damage.

SQLite does not notice a flipped bit in a value. So the row of a sample ends with a link, the CRC-32 over the row that
is begun with the link of the sample before it: neither a changed row nor a missing one in the middle passes. A history
row has a CRC-32 of its own. Columns since version 3 of the schema enter a checksum only where they have a value, so
that rows of before keep theirs.
"""

from __future__ import annotations

import logging
import math
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from adapters.reading import Quality, Reading
from service.errors import JournalError, reset_by_run
from service.records.history import HISTORY_COLUMNS, HistoryRow
from service.records.record import values
from service.records.sample import Array, Sample

Accepted = tuple[str, int, bytes, bytes, str, str, float | None]
"""zone, time, outputs, inputs, output_quality, input_quality, setpoint."""

SampleRow = tuple[str, int, bytes, bytes, str, str, float | None, int]
"""The same, and link."""


ReadingRow = tuple[str, float, str, float, str, int]
"""zone, time, channel, value, quality, checksum."""

_EARLIEST = -(2**63)

_log = logging.getLogger(__name__)

_FIRST = HISTORY_COLUMNS.index("gain_lower")
"""How many columns history rows had up to version 2."""
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
        None if math.isnan(sample.setpoint) else sample.setpoint + 0.0,
    )
    return (*row, link_of(previous, row))


def to_sample(row: Accepted) -> Sample:
    """The sample of a row without its link; ValueError or TypeError if it is none."""
    outputs, inputs = (np.frombuffer(blob, dtype="<f8").astype(np.float64) for blob in row[2:4])
    setpoint = math.nan if row[6] is None else float(row[6])
    return Sample(row[1], outputs, inputs, _qualities(row[4]), _qualities(row[5]), setpoint)


def linked_sample(row: Accepted, link: int | None, previous: int) -> Sample:
    """The sample of a row with `link` after one with the link `previous`.

    ValueError, TypeError or struct.error if it is damaged.
    """
    if link != link_of(previous, row):
        raise ValueError("it does not match its checksum, or the one before it is missing")
    return to_sample(row)


def damaged_sample(place: str, zone: str, time: int, reason: object, reset: str | None = None) -> JournalError:
    """What is told of a sample at `place` that cannot be used; `reset` as in StateMismatch."""
    return JournalError(
        f"{place} holds a damaged sample of zone '{zone}' at {time} ({reason}); check the disk, then restore a backup, "
        f"or give the zone's state up {reset or reset_by_run(zone)}"
    )


def history_row(zone: str, row: HistoryRow) -> tuple[object, ...]:
    """The columns of `row` with zone and checksum."""
    return (zone, *values(row), history_checksum(zone, row))


def history_checksum(zone: str, row: HistoryRow) -> int:
    """The CRC-32 of a history row as SQLite gives it back: it keeps neither the sign of zero nor the kind of NaN."""
    numbers = [math.nan if value != value else value + 0.0 for value in values(row)]
    checksum = zlib.crc32(_NUMBERS.pack(*numbers[:_FIRST]), zlib.crc32(zone.encode()))
    more = numbers[_FIRST:]
    return checksum if all(map(math.isnan, more)) else zlib.crc32(_MORE.pack(*more), checksum)


def to_history(row: tuple[float | None, ...]) -> HistoryRow:
    """The history row of its columns; ValueError or TypeError if it is none."""
    if not isinstance(row[0], int):
        raise ValueError("its time is no whole number")
    found = {name: math.nan if value is None else value for name, value in zip(HISTORY_COLUMNS, row, strict=True)}
    return HistoryRow(**(found | {"resampled": bool(found["resampled"])}))


def reading_row(zone: str, reading: Reading) -> ReadingRow:
    """The row of a reading that is usable."""
    # SQLite does not keep the sign of zero.
    row = (zone, reading.time + 0.0, reading.channel, reading.value + 0.0, str(reading.quality))
    return (*row, _reading_checksum(*row))


def to_reading(row: ReadingRow) -> Reading:
    """The reading of a row; ValueError or TypeError if it does not match its checksum."""
    zone, time, channel, value, quality, checksum = row
    if checksum != _reading_checksum(zone, float(time), channel, float(value), quality):
        raise ValueError("it does not match its checksum")
    return Reading(channel, float(time), float(value), Quality(quality))


def _reading_checksum(zone: str, time: float, channel: str, value: float, quality: str) -> int:
    return zlib.crc32(struct.pack("<2d", time, value), zlib.crc32(f"{zone}\0{channel}\0{quality}".encode()))


def sound_rows(
    zone: str, rows: Sequence[Sequence[Any]], unchecked_until: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """History rows with their checksums last, as a table (n, m), and which of them are sound (n,).

    Rows up to `unchecked_until` may be without a checksum.
    """
    width = len(HISTORY_COLUMNS)
    table, sound = np.full((len(rows), width), np.nan), np.zeros(len(rows), dtype=np.bool_)
    if not rows:
        return table, sound
    try:
        table = np.array([row[:width] for row in rows], dtype=np.float64)
    except (ValueError, TypeError):
        # A cell that is no number; the other rows are read one by one.
        for index, row in enumerate(rows):
            if all(cell is None or isinstance(cell, int | float) for cell in row[:width]):
                table[index] = np.array(row[:width], dtype=np.float64)
    # As `history_checksum` has it: neither the sign of zero nor the kind of NaN counts.
    numbers = np.where(np.isnan(table), np.nan, table + 0.0).astype("<f8")
    packed, added = memoryview(numbers[:, :_FIRST].tobytes()), memoryview(numbers[:, _FIRST:].tobytes())
    has_more = ~np.isnan(table[:, _FIRST:]).all(axis=1)
    seed, size, more = zlib.crc32(zone.encode()), _NUMBERS.size, _MORE.size
    for index, row in enumerate(rows):
        checksum = row[width]
        computed = zlib.crc32(packed[index * size : (index + 1) * size], seed)
        if has_more[index]:
            computed = zlib.crc32(added[index * more : (index + 1) * more], computed)
        sound[index] = isinstance(row[0], int) and (
            checksum == computed or (checksum is None and row[0] <= unchecked_until)
        )
    return table, sound


class HistoryReader:
    """History rows of the journal at `place`, as far as they are sound; the log says once of each that is not.

    Rows of a zone up to the time in `unchecked` may be without a checksum.
    """

    def __init__(self, place: str, unchecked: Mapping[str, int] | None = None) -> None:
        self._place = place
        self._unchecked = {} if unchecked is None else unchecked
        self._told: set[tuple[str, int]] = set()

    def row(self, zone: str, row: Sequence[Any], checksum: int | None) -> HistoryRow | None:
        """The history row of its columns; None if it is damaged."""
        try:
            history = to_history(tuple(row))
            unchecked = checksum is None and history.time <= self._unchecked.get(zone, _EARLIEST)
            if unchecked or checksum == history_checksum(zone, history):
                return history
        except (ValueError, TypeError, struct.error):
            pass
        if (zone, row[0]) not in self._told:
            self._told.add((zone, row[0]))
            _log.error("%s holds a damaged history row of zone '%s' at %s", self._place, zone, row[0])
        return None

    def table(self, zone: str, rows: Sequence[Sequence[Any]]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Those of `rows`, with their checksums last, that are sound: times (n,), and all columns (n, m)."""
        table, sound = sound_rows(zone, rows, self._unchecked.get(zone, _EARLIEST))
        for index in np.flatnonzero(~sound):
            *row, checksum = rows[int(index)]
            self.row(zone, row, checksum)
        return table[sound, 0].astype(np.int64), table[sound]


def _to_blob(values: Array) -> bytes:
    return np.asarray(values, dtype="<f8").tobytes()


def _qualities(text: str) -> tuple[Quality, ...]:
    return tuple(Quality(word) for word in text.split(",")) if text else ()
