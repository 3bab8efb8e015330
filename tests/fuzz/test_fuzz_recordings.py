"""Recorded files: whatever bytes they hold is read into readings and faults, or refused in sentences with its place."""

import asyncio
import gzip
import math
from contextlib import suppress
from zoneinfo import ZoneInfo

import numpy as np
from fuzz.fuzzing import folder, raw
from support.sources import played, recording

from adapters.csv.cells import Status, parse_numbers
from adapters.csv.times import parse_timestamps, to_utc
from adapters.errors import SourceConfigError, SourceError
from adapters.fields.durations import format_duration, parse_duration
from adapters.reading import Quality, Reading
from adapters.timestamps import EARLIEST, LATEST, timestamp_parser

BERLIN = ZoneInfo("Europe/Berlin")
FOLDER = folder()
ROWS = (
    b"Timestamp;T;P;E\n2025-03-30 01:59:00;20,5;0,4;1000\n2025-03-30 02:30:00;-;nan;1001\n"
    b"2025-10-26 02:30:00;21,5;0,3;1002\n2025-10-26 02:10:00;;1e999;3\n\n2025-10-26 03:10:00+01:00;19;0;4\n"
)
CHANNELS = [
    {"id": "z/T", "column": "T", "unit": "degC"},
    {"id": "z/P", "columns": ["P", "T"], "scale": 1e3, "valid": (-1e300, 1e300)},
    {"id": "z/E", "column": "E", "unit": "J", "to": "W", "rollover": 1e6, "valid": (-1e300, 1e300)},
]


def delivered(content: bytes, name: str, **settings: object) -> list[Reading]:
    """What a source makes of a file, or nothing where it says in a sentence why it cannot."""
    path = FOLDER / name
    path.write_bytes(content)
    ours = {"zone": "Europe/Berlin", "delimiter": ";", "decimal": ","} | settings
    source = recording("log", [path], CHANNELS, "Timestamp", **ours)
    for problem in source.check():
        assert str(path) in problem
    try:
        readings = [reading for batch in played(source) for reading in batch.readings]
        asyncio.run(source.probe(0.0))
    except SourceError as refused:
        error = str(refused)
    else:
        return readings
    assert str(path) in error
    return []


def check(readings: list[Reading]) -> None:
    for reading in readings:
        assert (reading.fault is None) == (reading.quality is not Quality.BAD)
        if reading.fault is None:
            assert math.isfinite(reading.value)
            assert EARLIEST <= reading.time < LATEST


@raw(ROWS, ROWS.replace(b";", b"\x00;"), b"\xef\xbb\xbf" + ROWS, b'"Timestamp;T;P;E\n', b"", examples=250)
def test_csv_file(data: bytes) -> None:
    check(delivered(data, "log.csv"))
    check(delivered(data, "log.csv", encoding="utf-16", decimal=".", delimiter=","))


@raw(gzip.compress(ROWS, mtime=0), gzip.compress(b"", mtime=0), examples=120)
def test_gzip_file(data: bytes) -> None:
    check(delivered(data, "log.csv.gz"))


@raw(b"20.5", b"1_000", b" -,5 ", b"1.234,5", b"NaN", b"n/a", b"0x10", "٣".encode(), examples=200)
def test_cells_of_numbers(data: bytes) -> None:
    texts = data.decode("utf-8", "replace").split("|")
    for decimal in (".", ","):
        cells = parse_numbers(texts, decimal)
        good = cells.status == Status.GOOD
        assert np.isfinite(cells.values[good]).all()
        assert np.isnan(cells.values[~good]).all()


@raw(b"2025-10-26 02:30:00|2025-10-26 02:10:00|1772000000|31.12.9999 23:59:59", examples=200)
def test_cells_of_timestamps(data: bytes) -> None:
    texts = data.decode("utf-8", "replace").split("|")
    for pattern in ("iso8601", "epoch", "%d.%m.%Y %H:%M:%S"):
        moments = parse_timestamps(texts, timestamp_parser(pattern))
        for zone in (None, BERLIN, ZoneInfo("Antarctica/Troll")):
            times = to_utc(moments, zone)
            good = times.status == Status.GOOD
            assert ((times.values[good] >= EARLIEST) & (times.values[good] < LATEST)).all()
            assert np.isnan(times.values[~good]).all()


@raw(b"5min", b"1.5e-3 h", b"7d", b"999999999999d", "٣s".encode(), examples=200)
def test_duration(data: bytes) -> None:
    with suppress(ValueError):
        seconds = parse_duration(data.decode("utf-8", "replace"))
        assert 0 <= seconds < math.inf
        assert parse_duration(format_duration(seconds)) == seconds


@raw(b"%d.%m.%Y %H:%M:%S", b"%Y-%j", b"%", b"%Q", b"%s", examples=150)
def test_timestamp_pattern(data: bytes) -> None:
    with suppress(SourceConfigError):
        parse = timestamp_parser(data.decode("utf-8", "replace"))
        parse_timestamps(["01.02.2025 10:00:00", "2025-02-01", ""], parse)
