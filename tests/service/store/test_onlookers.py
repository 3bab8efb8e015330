"""Who can look into a state folder and hold its lock, and what a cut-off journal and a full disk are told as."""

from __future__ import annotations

import errno
import sqlite3
import stat
from pathlib import Path

import pytest

from service.errors import JournalError, ServiceError
from service.store import store as module
from service.store.journal_file import translated
from service.store.store import Store


@pytest.mark.parametrize(("mode", "warned"), [(0o755, True), (0o701, True), (0o700, False), (0o750, False)])
def test_a_folder_that_every_account_can_enter_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, mode: int, warned: bool
) -> None:
    folder = tmp_path / "state"
    folder.mkdir()
    folder.chmod(mode)
    Store(folder).close()
    assert ("say: chmod o= " in caplog.text) == warned


def test_only_the_owner_can_open_the_lock(tmp_path: Path) -> None:
    (tmp_path / "lock").touch(0o644)
    (tmp_path / "lock").chmod(0o644)
    Store(tmp_path).close()
    assert stat.S_IMODE((tmp_path / "lock").stat().st_mode) == 0o600


def test_a_disk_that_fails_is_thought_of_before_the_file(tmp_path: Path) -> None:
    error = sqlite3.DatabaseError("database disk image is malformed")
    error.sqlite_errorname = "SQLITE_CORRUPT"
    with (
        pytest.raises(JournalError, match=r"whether its disk has failed.*if the file itself is damaged"),
        translated(tmp_path),
    ):
        raise error


def test_a_full_disk_is_refused_with_what_frees_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(module, "make_folder", full)
    with pytest.raises(ServiceError, match=r"free space on its disk: .*reset-\*.*old backups"):
        Store(tmp_path / "state")
