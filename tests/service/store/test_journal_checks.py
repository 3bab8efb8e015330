"""What SQLite does not notice: changed values, missing rows, a damaged log, a journal that ends too early."""

from __future__ import annotations

import logging
import shutil
from contextlib import closing
from pathlib import Path

import pytest
from support.fake_zones import PERIOD, make_sample, make_update
from support.running_zone import Announced, fed, finished, make, plumbing, straight
from support.zone_samples import comparable, sample

from service.store.journal import Journal
from service.store.retention import Limits, prune
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


async def lived(folder: Path, items: list) -> list[str]:
    """What a zone on `folder` announces when it takes `items` after what it had."""
    announcer = Announced()
    async with plumbing(folder, announcer) as shared:
        zone = make(shared)
        await finished(zone, await fed(zone, items))
    return [comparable(update) for _, update in announcer.updates]


async def test_with_the_journal_moved_away_a_zone_goes_on_from_its_checkpoint(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    items = [sample(k) for k in range(60)]
    await lived(tmp_path, items[:40])
    (tmp_path / JOURNAL).unlink()

    async with plumbing(tmp_path) as shared:
        assert await make(shared).prepare() == items[39].time, "not from the beginning"
    assert "goes on from its checkpoint at 1970-01-01T03:15:00Z, but the journal ends" in caplog.text
    assert await lived(tmp_path, items[40:]) == straight(items)[39:]


async def test_without_checkpoints_a_pruned_zone_learns_anew_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    items = [sample(k) for k in range(60)]
    await lived(tmp_path, items)
    with closing(Journal.open(tmp_path / JOURNAL)) as journal:
        list(prune(journal, lambda zone: items[-1].time, Limits(9.0 * PERIOD, 1e12)))
    for file in (tmp_path / "checkpoints").rglob("*.npz"):
        file.write_bytes(b"")
    announced = await lived(tmp_path, [])
    assert announced == straight(items[50:])[-1:], "it knows what the samples that are left teach"
    assert "it has learned anew from the later ones" in caplog.text
    caplog.clear()
    await lived(tmp_path, [])
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING], "said once"
