"""The journal: durable, bit-exact, and plain about what is wrong with it."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from support.tables import tabled

from service.errors import JournalError
from service.store.journal import Journal
from service.store.journal_file import translated


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "journal.sqlite3"


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


@tabled
def test_what_sqlite_says_is_told_with_its_remedy(name: str, remedy: str, path: Path) -> None:
    error = sqlite3.DatabaseError("as\n  SQLite has it")
    error.sqlite_errorname = name
    told = rf"the journal {path} failed \(as SQLite has it\); .*{remedy}"
    with pytest.raises(JournalError, match=told), translated(path):
        raise error
