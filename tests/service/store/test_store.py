"""The store of a folder: who may look into it, and that it accepts nothing that would be lost."""

import asyncio
import errno
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from support.waiting import until
from support.zone_samples import sample

from service.errors import JournalError, ServiceError
from service.store import store as module
from service.store.checkpoint import Checkpoint
from service.store.store import Store
from service.web.keys import create_key, revoke_key


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    opened = Store(tmp_path / "state")
    yield opened
    opened.close()


async def test_a_failed_commit_is_told_to_everyone_in_it_and_the_next_one_works(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    commits, real = list[int](), store.journal.append_all

    def append_all(accepted: Any, readings: Any) -> int:
        commits.append(len(accepted))
        if len(commits) == 1:
            raise JournalError("the journal failed (disk full); free space on its disk")
        return real(accepted, readings)

    monkeypatch.setattr(store.journal, "append_all", append_all)
    first = await asyncio.gather(*(store.append(zone, sample(0)) for zone in "abc"), return_exceptions=True)
    assert [type(result) for result in first] == [JournalError] * 3
    assert await store.run(store.journal.last_sample_time, "a") is None
    await asyncio.gather(*(store.append(zone, sample(0)) for zone in "abc"))
    assert await store.run(store.journal.last_sample_time, "c") == sample(0).time
    assert commits == [3, 3]


def _move(folder: Path) -> None:
    folder.rename(folder.with_name("moved"))


def _replace(folder: Path) -> None:
    _move(folder)
    Store(folder).close()


@pytest.mark.parametrize(
    "take_away", [shutil.rmtree, _move, _replace, lambda folder: (folder / "journal.sqlite3").unlink()]
)
async def test_nothing_is_accepted_into_a_folder_that_has_been_taken_away(
    store: Store, caplog: pytest.LogCaptureFixture, take_away: Callable[[Path], object]
) -> None:
    await store.append("z", sample(0))
    assert store.problems() == []
    take_away(store.path)
    for _ in range(2):
        with pytest.raises(JournalError, match="has been deleted or replaced while the daemon runs"):
            await store.append("z", sample(1))
    with pytest.raises(JournalError):
        await store.run(store.journal.flush)
    assert await store.run(store.journal.last_sample_time, "z") == sample(0).time, "reading goes on"
    assert [str(store.path) in problem for problem in store.problems()] == [True]
    assert [record.levelname for record in caplog.records] == ["ERROR"], "said once"


async def test_a_folder_that_is_put_back_is_written_to_again(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Store, "look_seconds", 0.01)
    watching = asyncio.create_task(store.watch())
    _move(store.path)
    await until(store.problems)
    store.path.with_name("moved").rename(store.path)
    await until(lambda: not store.problems())
    watching.cancel()
    await store.append("z", sample(0))
    store.close()
    again = Store(store.path)
    assert await again.run(again.journal.last_sample_time, "z") == sample(0).time
    again.close()


def test_only_the_owner_can_look_in(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = tmp_path / "var" / "state"
        store = Store(folder)
        store.checkpoints.save("living", Checkpoint("f", 0, {}, {}))
        store.close()
        create_key(folder / "keys.json", "one", "read")
        revoke_key(folder / "keys.json", "one")
    finally:
        os.umask(before)
    found = {path: stat.S_IMODE(path.stat().st_mode) for path in (folder, *folder.rglob("*"))}
    assert found == {path: 0o700 if path.is_dir() else 0o600 for path in found}
    assert {path.suffix for path in found} >= {".sqlite3", ".npz", ".json"}


@pytest.mark.parametrize(("mode", "warned"), [(0o755, True), (0o701, True), (0o700, False), (0o750, False)])
def test_a_folder_that_every_account_can_enter_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, mode: int, warned: bool
) -> None:
    (tmp_path / "lock").touch(0o644)
    tmp_path.chmod(mode)
    Store(tmp_path).close()
    assert ("say: chmod o= " in caplog.text) == warned
    assert stat.S_IMODE((tmp_path / "lock").stat().st_mode) == 0o600, "whoever can open it can hold it"


def test_a_full_disk_is_refused_with_what_frees_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "make_folder", Mock(side_effect=OSError(errno.ENOSPC, "No space left on device")))
    with pytest.raises(ServiceError, match=r"free space on its disk: .*reset-\*.*old backups"):
        Store(tmp_path / "state")
