"""What SQLite does not notice: changed values, missing rows, a damaged log, a journal that ends too early."""

from __future__ import annotations

import shutil
from contextlib import closing
from pathlib import Path

import pytest
from support.fake_zones import make_sample, make_update
from support.running_zone import Announced, fed, finished, make, plumbing, straight
from support.zone_samples import comparable, sample

from service.store.journal import Journal
from service.store.store import JOURNAL


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A journal with ten samples and rows of history of each of two zones."""
    path = tmp_path / JOURNAL
    with closing(Journal.open(path)) as journal:
        for step in range(10):
            journal.append_all([("living", make_sample(step)), ("bedroom", make_sample(step))])
            journal.record("living", make_update(step))
    return path


def killed_log(path: Path, folder: Path) -> Path:
    """A copy of the journal with a write-ahead log of four more transactions, as a kill leaves it."""
    with closing(Journal.open(path)) as journal:
        for step in range(10, 14):
            journal.append_all([("living", make_sample(step))])
        shutil.copytree(path.parent, folder, ignore=shutil.ignore_patterns("*-shm"))
    return folder / JOURNAL


def test_a_whole_log_is_no_word_worth(path: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with closing(Journal.open(killed_log(path, tmp_path / "copy"))) as journal:
        assert len(list(journal.samples_after("living", None))) == 14
    assert not caplog.records


@pytest.mark.parametrize(("place", "left"), [(-2 * 4120 + 100, 12), (-4120 + 100, 13), (-1, 13), (0, 10), (8, 10)])
def test_behind_a_damaged_place_in_its_log_nothing_is_made_up_and_that_is_told(
    place: int, left: int, path: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    copy = killed_log(path, tmp_path / "copy")
    log = copy.with_name(f"{JOURNAL}-wal")
    content = bytearray(log.read_bytes())
    content[place] ^= 1
    log.write_bytes(content)
    with closing(Journal.open(copy)) as journal:
        assert len(list(journal.samples_after("living", None))) == left, "as after an earlier crash"
    assert f"{log} is damaged, and what was accepted last is lost behind that place" in caplog.text


async def test_with_the_journal_moved_away_a_zone_goes_on_from_its_checkpoint(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    items, announcer = [sample(k) for k in range(60)], Announced()
    async with plumbing(tmp_path) as shared:
        zone = make(shared)
        await finished(zone, await fed(zone, items[:40]))
    (tmp_path / JOURNAL).unlink()
    async with plumbing(tmp_path, announcer) as shared:
        zone = make(shared)
        await finished(zone, await fed(zone, items[40:]))
    assert "goes on from its checkpoint at 1970-01-01T03:15:00Z, but the journal ends" in caplog.text
    assert [comparable(update) for _, update in announcer.updates] == straight(items)[39:]
