import asyncio
import gzip
import os
import threading
from datetime import UTC, datetime
from math import isnan

import pytest
from support.sources import played, recording
from support.tables import tabled
from support.waiting import until, wait_until

import adapters.csv.source
from adapters.csv.table import read_table
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.reading import Fault, Quality

TEMPERATURE = {"id": "living/T_air", "column": "T"}


def utc(text):
    return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()


def write(path, text, encoding="utf-8"):
    data = text.encode(encoding)
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
    return path


def source(*files, channels=(TEMPERATURE,), **settings):
    return recording("recording", files, channels, **settings)


def readings(csv_source, start=None):
    return [reading for batch in played(csv_source, start) for reading in batch.readings]


def values(csv_source, start=None):
    return [(reading.time, reading.value) for reading in readings(csv_source, start)]


@tabled
def test_files_as_loggers_write_them(tmp_path, name, text, settings):
    if settings.get("decimal") == ",":
        settings = settings | {"format": "%d.%m.%Y %H:%M", "zone": "Europe/Berlin"}
    windows = source(write(tmp_path / name, text, settings.get("encoding", "utf-8")), **settings)
    assert windows.check() == []
    assert values(windows) == [(utc("2025-05-03"), 20.5)]


def test_columns_are_summed_then_scaled_then_converted(tmp_path):
    path = write(tmp_path / "a.csv", "t,a,b\n0,0.5,0.25\n10,1,\n20,x,1\n30,,x\n40,1,1\n")
    heat = {
        "id": "z/u",
        "columns": ["a", "b"],
        "unit": "kW",
        "to": "W",
        "scale": 2.0,
        "offset": 0.1,
        "valid": (0, 3000),
    }
    found = [(one.time, one.fault or one.value) for one in readings(source(path, channels=[heat], format="epoch"))]
    assert found == [(0.0, 1600.0), (20.0, Fault.NON_NUMERIC), (30.0, Fault.NON_NUMERIC), (40.0, Fault.OUT_OF_RANGE)]


@tabled
def test_each_bad_cell_is_delivered_with_its_fault_and_missing_ones_not_at_all(tmp_path, decimal, cells):
    path = write(tmp_path / "a.csv", "\n".join(["t;T", *(f"{second};{cell}" for second, cell in enumerate(cells))]))
    channel = {"id": "z/T", "column": "T", "unit": "degC"}
    layout = {"delimiter": ";", "decimal": decimal, "format": "epoch"}
    got = readings(source(path, channels=[channel], **layout))
    assert {reading.time: reading.fault or reading.value for reading in got} == {
        float(second): expected for second, expected in enumerate(cells.values()) if expected is not None
    }
    for reading in got:
        assert isnan(reading.value) == (reading.quality is Quality.BAD) == (reading.fault is not None)
    # A number that stands alone is read by a shorter way, which has to agree.
    for cell, expected in cells.items():
        path.write_text(f"t;T\n0;{cell}\n")
        alone = [one.fault or one.value for one in readings(source(path, channels=[channel], **layout))]
        assert alone == ([] if expected is None else [expected])


@pytest.mark.parametrize(
    ("text", "fault"), [("2025-05-03 00:00:10", Fault.NAIVE_TIMESTAMP), ("garbage", Fault.BAD_TIMESTAMP)]
)
def test_a_refused_timestamp_is_one_fault_per_channel_where_it_stands(tmp_path, text, fault):
    path = write(tmp_path / "a.csv", f"t,T,U\n1970-01-01 00:00:00Z,1,2\n{text},1,\n1970-01-01 00:00:20Z,1,2\n")
    first, last = played(source(path, channels=[{"id": f"z/{name}", "column": name} for name in "TU"], pace=1e6))
    assert (first.now, last.now) == (0.0, 20.0)
    refused = [reading for reading in first.readings if reading.fault]
    assert [(reading.channel, reading.fault) for reading in refused] == [("z/T", fault), ("z/U", fault)]
    assert all(isnan(reading.time) and isnan(reading.value) for reading in refused)
    assert len(last.readings) == 2


def test_rows_of_one_file_are_ordered_by_time_and_equal_times_keep_their_order(tmp_path):
    path = write(tmp_path / "a.csv", "t,T\n30,3\n10,1\n20,2\n10,1.5\n")
    assert values(source(path, format="epoch")) == [(10.0, 1.0), (10.0, 1.5), (20.0, 2.0), (30.0, 3.0)]


def test_files_follow_one_another_and_the_clock_never_goes_back(tmp_path):
    paths = [
        write(tmp_path / "a.csv", "t,T\n10,1\n30,3\n"),
        write(tmp_path / "empty.csv", "T,t\n"),
        write(tmp_path / "b.csv.gz", "x,T,t\n0,2,20\n0,4,40\n"),
    ]
    got = played(source(*paths, format="epoch", pace=1e9))
    assert [(batch.readings[0].value, batch.now) for batch in got] == [(1.0, 10), (3.0, 30), (2.0, 30), (4.0, 40)]


def test_start_skips_what_came_before_in_every_file(tmp_path):
    first = write(tmp_path / "a.csv", "t,T\nx,9\n10,1\nx,9\n20,2\nx,9\n")
    told = source(first, write(tmp_path / "b.csv", "t,T\n25,3\n"), format="epoch")
    assert [reading.time for reading in readings(told, 20.0)][0::2] == [20.0, 25.0]
    assert values(told, 20.5) == [(25.0, 3.0)]
    assert values(told, 26.0) == []


def test_many_rows_come_in_few_batches_and_all_of_them(tmp_path):
    path = write(tmp_path / "a.csv", "t,T\n" + "".join(f"{i},{i % 7}\n" for i in range(10_000)))
    got = played(source(path, format="epoch"))
    assert [reading.time for batch in got for reading in batch.readings] == list(range(10_000))
    assert all(batch.now == batch.readings[-1].time for batch in got)
    assert len(got) < 10


async def test_lateness_does_not_add_up(tmp_path, monkeypatch):
    """Every sleep ends 30 ms late."""
    path = write(tmp_path / "a.csv", "t,T\n" + "".join(f"{100 + i},{i}\n" for i in range(101)))
    paced = source(path, format="epoch", pace=20.0)
    sleep, now = asyncio.sleep, [0.0]

    async def oversleep(seconds):
        now[0] += seconds + 0.03 if seconds else 0.0
        await sleep(0)

    monkeypatch.setattr(asyncio.get_running_loop(), "time", lambda: now[0])
    monkeypatch.setattr(adapters.csv.source.asyncio, "sleep", oversleep)
    try:
        got = [now[0] async for _ in paced.batches(None)]
    finally:
        monkeypatch.undo()
    assert len(got) == 101
    assert all(0 <= when - i / 20 <= 0.031 for i, when in enumerate(got))


async def test_closing_ends_a_delivery_that_is_asleep(tmp_path):
    told = source(write(tmp_path / "a.csv", "t,T\n0,1\n100000,2\n"), format="epoch", pace=1.0)
    async with asyncio.timeout(180):
        got = []
        async for batch in told.batches(None):
            got.append(batch.now)
            asyncio.get_running_loop().call_later(0.05, asyncio.ensure_future, told.close())
        await told.close()
    assert got == [0.0]


async def test_reading_a_large_file_leaves_the_event_loop_alive_and_stops_when_cancelled(tmp_path, monkeypatch):
    path = write(tmp_path / "a.csv", "t,T\n" + "1746230410,20.5\n" * 1000)
    begun, read = threading.Event(), []

    def read_large(file, channels, layout, stopped, content):
        begun.set()
        wait_until(stopped)
        read.append(read_table(file, channels, layout, stopped, content).order.size)

    monkeypatch.setattr(adapters.csv.source, "read_table", read_large)
    task = asyncio.ensure_future(anext(aiter(source(path, format="epoch").batches(None))))
    await until(begun.is_set)
    assert not task.done()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    # The reading thread must have noticed.
    await until(lambda: read)
    assert read == [0]


def test_check_names_every_problem_with_its_file(tmp_path):
    missing, empty = tmp_path / "missing.csv", write(tmp_path / "empty.csv", "")
    wrong = write(tmp_path / "wrong.csv", "time,T,T\n")
    semicolons = write(tmp_path / "semi.csv", "t;T\n1;2\n")
    torn = tmp_path / "torn.csv.gz"
    torn.write_bytes(gzip.compress(b"t,T\n")[:12])
    problems = source(missing, empty, wrong, semicolons, torn, tmp_path).check()
    expected = [
        f"sources.recording: file '{missing}' cannot be read (No such file or directory); check its path",
        f"sources.recording: file '{empty}' is empty; it needs a first line with the names of its columns",
        f"sources.recording: file '{wrong}' has no column 't' (the timestamp); its columns are: time, T, T",
        f"sources.recording: file '{wrong}' has the column 'T' (channel living/T_air) more than once",
        f"sources.recording: file '{semicolons}' has no column 't' (the timestamp); its columns are: t;T; is the del",
        f"sources.recording: file '{semicolons}' has no column 'T' (channel living/T_air); its columns are: t;T; is",
        f"sources.recording: file '{torn}' is no complete gzip file",
        f"sources.recording: file '{tmp_path}' cannot be read (Is a directory)",
    ]
    assert len(problems) == len(expected)
    for problem, beginning in zip(problems, expected, strict=True):
        assert problem.startswith(beginning)


@pytest.mark.parametrize("name", ["pipe.csv", "pipe.parquet"])
def test_a_pipe_is_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    (problem,) = source(tmp_path / name).check()
    assert "is a pipe or a device; give a file" in problem


def test_a_missing_column_and_an_endless_quote_are_told_when_running(tmp_path):
    with pytest.raises(SourceConfigError, match="has no column 'T'"):
        played(source(write(tmp_path / "a.csv", "t,U\n0,1\n")))
    with pytest.raises(SourceUnavailable, match="look for a quote that is not closed"):
        played(source(write(tmp_path / "b.csv", 't,T\n0,"1' + "0" * 200_000)))


def test_a_column_without_a_name(tmp_path):
    file = write(tmp_path / "pandas.csv", ",T\n2025-05-03 00:00:00Z,20.5\n")
    assert values(source(file, column="")) == [(utc("2025-05-03"), 20.5)]
    other = write(tmp_path / "last.csv", "t,T,\n2025-05-03 00:00:00Z,20.5,7\n")
    assert values(source(other, channels=({"id": "living/T_air", "column": ""},))) == [(utc("2025-05-03"), 7.0)]
    assert source(other, column="", channels=()).check() == []
    for text, said in (
        (",T,\n", "has the column without a name (the timestamp) more than once; rename all but one"),
        ("t,T\n", "has no column without a name (the timestamp); its columns are: t, T"),
    ):
        (problem,) = source(write(tmp_path / "other.csv", text), column="").check()
        assert said in problem
