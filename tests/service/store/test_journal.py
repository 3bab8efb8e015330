"""The journal: durable, bit-exact, and plain about what is wrong with it."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest
from support.fake_zones import START, make_sample, make_update

from service.errors import JournalError
from service.store.journal import Journal


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "journal.sqlite3"


@pytest.fixture
def journal(path: Path) -> Iterator[Journal]:
    journal = Journal.open(path)
    yield journal
    journal.close()


def test_writing_while_reading_samples(journal: Journal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.store.journal.PAGE", 2)
    for step in range(5):
        journal.append_all([("living", make_sample(step))])
    seen = 0
    for step, _ in enumerate(journal.samples_after("living", None)):
        journal.record("living", make_update(step))
        journal.flush()
        seen += 1
    assert seen == 5
    assert len(journal.history("living", None, None, 10)) == 5


def sql(statement: str) -> Callable[[Path], None]:
    """A change by SQLite itself."""

    def change(path: Path) -> None:
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute(statement)

    return change


def garbled(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"CREATE TABLE samples", b"CREATE \xe7\xff\xfeBLE samples"))


@pytest.mark.parametrize(
    ("there", "change", "told"),
    [
        (True, sql("PRAGMA user_version = 7"), r"schema 7 of a newer Thermogate .*upgrade Thermogate"),
        (True, sql("PRAGMA user_version = 2"), r"schema 2 of an unreleased Thermogate.*use another state_dir"),
        (True, garbled, r"failed .*restore a backup"),
        (False, sql("CREATE TABLE letters (text)"), "not a Thermogate journal"),
        (False, lambda path: path.write_bytes(b"certainly not SQLite" * 100), "move it away"),
    ],
)
def test_what_is_no_journal_of_this_version_is_refused_untouched(
    there: bool, change: Callable[[Path], object], told: str, path: Path
) -> None:
    path.parent.mkdir()
    if there:
        Journal.open(path).close()
    change(path)
    before = path.read_bytes()
    with pytest.raises(JournalError, match=told):
        Journal.open(path)
    assert path.read_bytes() == before


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JournalError, match="folder of the journal"):
        Journal.open(tmp_path / "file" / "journal.sqlite3")


def test_a_full_disk_loses_nothing_that_was_recorded(path: Path, journal: Journal) -> None:
    journal.append_all([("living", make_sample(0))])
    ((pages,),) = journal.read("PRAGMA page_count")
    journal.read(f"PRAGMA max_page_count = {pages}")
    for step in range(100):
        journal.record("living", make_update(step))
    with pytest.raises(JournalError, match="free space on its disk"):
        journal.append_all([("living", make_sample(1))])
    assert journal.last_sample_time("living") == START
    assert journal.history("living", None, None, 1000) == [], "what is there is read all the same"
    assert journal.history_columns("living", 0, 2 * START, 1)[2] is None
    journal.read("PRAGMA max_page_count = 100000")
    assert journal.append_all([("living", make_sample(1))])
    assert len(journal.history("living", None, None, 1000)) == 100


def test_another_writer_is_named_as_the_cause(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.store.journal_file.BUSY_SECONDS", 0.05)
    journal = Journal.open(path)
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(JournalError, match="stop the other process"):
        journal.append_all([("living", make_sample(0))])
    other.execute("ROLLBACK")
    other.close()
    assert journal.append_all([("living", make_sample(0))])
    journal.close()
