"""The journal: durable, bit-exact, and plain about what is wrong with it."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from support.fake_zones import PERIOD, START, make_sample, make_update

from adapters.reading import Quality
from service.errors import JournalError
from service.records.sample import Sample
from service.store.journal import Journal


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "journal.sqlite3"


@pytest.fixture
def journal(path: Path) -> Iterator[Journal]:
    journal = Journal.open(path)
    yield journal
    journal.close()


def bits(array: np.ndarray) -> bytes:
    return array.astype("<f8").tobytes()


def test_samples_come_back_bit_for_bit(path: Path, journal: Journal) -> None:
    odd = np.frombuffer(np.uint64(0x7FF8DEADBEEF0001).tobytes(), dtype=np.float64)[0]  # a NaN with a payload
    values = np.array([odd, -0.0, np.inf, 5e-324, 0.1 + 0.2])
    sample = Sample(START, np.array([np.nan]), values, (Quality.BAD,), (Quality.GOOD,) * 5)
    assert journal.append("living", sample)
    journal.close()
    reopened = Journal.open(path)
    (read,) = reopened.samples_after("living", None)
    reopened.close()
    assert (bits(read.outputs), bits(read.inputs)) == (bits(sample.outputs), bits(sample.inputs))
    assert (read.time, read.output_quality, read.input_quality) == (START, (Quality.BAD,), (Quality.GOOD,) * 5)
    assert all(isinstance(quality, Quality) for quality in read.input_quality)


def test_a_network_without_inputs_has_empty_arrays(journal: Journal) -> None:
    journal.append("living", Sample(START, np.array([20.0]), np.empty(0), (Quality.GOOD,), ()))
    (read,) = journal.samples_after("living", None)
    assert read.inputs.shape == (0,)
    assert read.input_quality == ()


def test_writing_while_reading_samples(journal: Journal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.store.journal._PAGE", 2)
    for step in range(5):
        journal.append("living", make_sample(step))
    seen = 0
    for step, _ in enumerate(journal.samples_after("living", None)):
        journal.record("living", make_update(step))
        journal.flush()
        seen += 1
    assert seen == 5
    assert len(journal.history("living", None, None, 10)) == 5


def test_an_append_is_durable_when_the_process_is_killed(path: Path) -> None:
    script = (
        "import os, sys; sys.path[:0] = ['.', 'tests']\n"
        "from pathlib import Path\n"
        "from service.store.journal import Journal\n"
        "from support.fake_zones import make_sample, make_update\n"
        f"journal = Journal.open(Path({str(path)!r}))\n"
        "journal.record('living', make_update(0)); journal.append('living', make_sample(1))\n"
        "journal.record('living', make_update(1)); os._exit(9)\n"
    )
    root = Path(__file__).parents[3]
    assert subprocess.run([sys.executable, "-c", script], cwd=root, check=False).returncode == 9
    journal = Journal.open(path)
    assert journal.last_sample_time("living") == START + PERIOD
    assert [row.time for row in journal.history("living", None, None, 10)] == [START], "recorded before the append"
    journal.close()


def test_many_rows_are_flushed_on_the_way(path: Path, journal: Journal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.store.journal._PENDING_LIMIT", 5)
    for step in range(6):
        journal.record("living", make_update(step))
    other = Journal.open(path)
    assert len(other.history("living", None, None, 100)) == 5
    other.close()


def test_a_skipped_sample_is_left_out_but_not_lost(path: Path, journal: Journal) -> None:
    for step in range(3):
        journal.append("living", make_sample(step))
    journal.skip("living", START + PERIOD, "the step failed twice")
    assert [sample.time - START for sample in journal.samples_after("living", None)] == [0, 2 * PERIOD]
    journal.skip("living", START + 2 * PERIOD, "again")
    assert journal.last_sample_time("living") == START + 2 * PERIOD
    with sqlite3.connect(path) as connection:
        reasons = connection.execute("SELECT skipped FROM samples ORDER BY time").fetchall()
    connection.close()
    assert reasons == [(None,), ("the step failed twice",), ("again",)]


def test_a_newer_schema_is_refused_with_a_remedy(path: Path, journal: Journal) -> None:
    journal.close()
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA user_version = 7")
    connection.close()
    with pytest.raises(JournalError, match=r"schema 7 of a newer Thermogate .*upgrade Thermogate"):
        Journal.open(path)


def test_another_programs_database_is_refused_untouched(tmp_path: Path) -> None:
    path = tmp_path / "other.sqlite3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE letters (text)")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(JournalError, match="not a Thermogate journal"):
        Journal.open(path)
    assert path.read_bytes() == before


def test_a_file_that_is_no_database(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite3"
    path.write_bytes(b"certainly not SQLite" * 100)
    with pytest.raises(JournalError, match="move it away"):
        Journal.open(path)


def test_a_damaged_page_is_reported_when_it_is_read(path: Path, journal: Journal) -> None:
    for step in range(200):
        journal.append("living", make_sample(step))
    journal.close()
    content = bytearray(path.read_bytes())
    content[4096:] = b"\xff" * (len(content) - 4096)
    path.write_bytes(content)
    with pytest.raises(JournalError, match="failed"), closing(Journal.open(path)) as reopened:
        list(reopened.samples_after("living", None))


def test_a_damaged_schema_of_which_sqlite_speaks_in_bytes(path: Path, journal: Journal) -> None:
    journal.close()
    path.write_bytes(path.read_bytes().replace(b"CREATE TABLE samples", b"CREATE \xe7\xff\xfeBLE samples"))
    with pytest.raises(JournalError, match=r"failed .*restore a backup"):
        Journal.open(path)


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JournalError, match="folder of the journal"):
        Journal.open(tmp_path / "file" / "journal.sqlite3")


def test_a_full_disk_loses_nothing_that_was_recorded(path: Path, journal: Journal) -> None:
    journal.append("living", make_sample(0))
    ((pages,),) = journal.read("PRAGMA page_count")
    journal.read(f"PRAGMA max_page_count = {pages}")
    for step in range(100):
        journal.record("living", make_update(step))
    with pytest.raises(JournalError, match="free space on its disk"):
        journal.append("living", make_sample(1))
    assert journal.last_sample_time("living") == START
    assert journal.history("living", None, None, 1000) == [], "what is there is read all the same"
    assert journal.history_columns("living", 0, 2 * START, 1)[2] is None
    journal.read("PRAGMA max_page_count = 100000")
    assert journal.append("living", make_sample(1))
    assert len(journal.history("living", None, None, 1000)) == 100


def test_another_writer_is_named_as_the_cause(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.store.journal._BUSY_SECONDS", 0.05)
    journal = Journal.open(path)
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(JournalError, match="stop the other process"):
        journal.append("living", make_sample(0))
    other.execute("ROLLBACK")
    other.close()
    assert journal.append("living", make_sample(0))
    journal.close()


def test_it_writes_ahead_and_syncs_fully(journal: Journal) -> None:
    assert journal.read("PRAGMA journal_mode") == [("wal",)]
    assert journal.read("PRAGMA synchronous") == [(2,)]
