"""Journal and checkpoints behind the event loop: samples that come together share commits, and nothing is lost."""

import asyncio
import shutil

import pytest
from support.zone_samples import sample

import service.store.store
from service.errors import JournalError
from service.store.store import Store


@pytest.fixture
def store(tmp_path):
    opened = Store(tmp_path)
    yield opened
    opened.close()


def spied(store, monkeypatch, failures=()):
    """How many samples each commit took; the first commits raise `failures`."""
    commits, real, left = [], store.journal.append_all, list(failures)

    def append_all(accepted):
        commits.append(len(accepted))
        if left:
            raise left.pop(0)
        return real(accepted)

    monkeypatch.setattr(store.journal, "append_all", append_all)
    return commits


async def test_a_failed_commit_is_told_to_everyone_in_it_and_the_next_one_works(store, monkeypatch):
    commits = spied(store, monkeypatch, [JournalError("the journal failed (disk full); free space on its disk")])
    first = await asyncio.gather(*(store.append(zone, sample(0)) for zone in "abc"), return_exceptions=True)
    assert [type(result) for result in first] == [JournalError] * 3
    assert await store.run(store.journal.last_sample_time, "a") is None
    await asyncio.gather(*(store.append(zone, sample(0)) for zone in "abc"))
    assert await store.run(store.journal.last_sample_time, "c") == sample(0).time
    assert commits == [3, 3]


def _delete(folder):
    shutil.rmtree(folder)


def _move(folder):
    folder.rename(folder.with_name("moved"))


def _replace(folder):
    folder.rename(folder.with_name("moved"))
    Store(folder).close()


def _delete_journal(folder):
    (folder / "journal.sqlite3").unlink()


@pytest.mark.parametrize("take_away", [_delete, _move, _replace, _delete_journal])
def test_nothing_is_accepted_into_a_folder_that_has_been_taken_away(tmp_path, caplog, take_away):
    folder = tmp_path / "state"
    store = Store(folder)

    async def scenario():
        await store.append("z", sample(0))
        assert store.problems() == []
        take_away(folder)
        for _ in range(2):
            with pytest.raises(JournalError, match="has been deleted or replaced while the daemon runs"):
                await store.append("z", sample(1))
        with pytest.raises(JournalError):
            await store.write(store.journal.flush)
        assert await store.run(store.journal.last_sample_time, "z") == sample(0).time, "reading goes on"
        return store.problems()

    try:
        (problem,) = asyncio.run(scenario())
    finally:
        store.close()
    assert str(folder) in problem
    assert [record.levelname for record in caplog.records] == ["ERROR"], "said once"


def test_a_folder_that_is_put_back_is_written_to_again(tmp_path, monkeypatch):
    monkeypatch.setattr(service.store.store.Store, "look_seconds", 0.01)
    folder = tmp_path / "state"
    store = Store(folder)

    async def scenario():
        watching = asyncio.create_task(store.watch())
        _move(folder)
        async with asyncio.timeout(60):
            while not store.problems():
                await asyncio.sleep(0.01)
            folder.with_name("moved").rename(folder)
            while store.problems():
                await asyncio.sleep(0.01)
        watching.cancel()
        await store.append("z", sample(0))

    asyncio.run(scenario())
    store.close()
    again = Store(folder)
    assert asyncio.run(again.run(again.journal.last_sample_time, "z")) == sample(0).time
    again.close()
