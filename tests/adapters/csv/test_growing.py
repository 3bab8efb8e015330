"""A recording that somebody else goes on writing."""

import pytest
from support.sources import recording

from adapters.csv.growing import GrowingFile
from adapters.errors import SourceUnavailable

HEAD = b"time,T\n"


def row(minute, value):
    return f"2025-01-01T00:{minute:02d}:00Z,{value}\n".encode()


def test_only_whole_lines_count_and_each_once(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(HEAD + row(0, 20) + row(1, 21)[:-3])
    growing = GrowingFile(path)
    assert growing.piece() == HEAD + row(0, 20)
    assert growing.piece() is None
    with path.open("ab") as file:
        file.write(row(1, 21)[-3:])
    assert growing.piece() == HEAD + row(1, 21)
    assert growing.piece() is None


def test_a_file_that_is_begun_anew_is_read_from_its_beginning(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(HEAD + row(0, 20) + row(1, 21))
    growing = GrowingFile(path)
    assert growing.piece()
    path.write_bytes(HEAD + row(2, 22))
    assert growing.piece() == HEAD + row(2, 22)
    (tmp_path / "next.csv").write_bytes(HEAD + row(3, 23) + row(4, 24) + row(5, 25))
    (tmp_path / "next.csv").replace(path)
    assert growing.piece() == HEAD + row(3, 23) + row(4, 24) + row(5, 25)
    path.unlink()
    with pytest.raises(SourceUnavailable, match="cannot be read"):
        growing.piece()


async def test_a_followed_source_delivers_what_is_appended_and_ends_when_it_is_closed(tmp_path):
    first, last = tmp_path / "old.csv", tmp_path / "log.csv"
    first.write_bytes(HEAD + row(0, 20))
    last.write_bytes(HEAD + row(1, 21))
    source = recording("logger", [first, last], [{"id": "room/T", "column": "T"}], "time", follow=True)
    values: list[float] = []
    async for batch in source.batches(None):
        values += [reading.value for reading in batch.readings]
        if len(values) == 2:
            with last.open("ab") as file:
                file.write(row(2, 22) + row(3, 23))
        if len(values) == 4:
            await source.close()
    assert values == [20, 21, 22, 23]
