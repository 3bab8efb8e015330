"""The journal keeps what its limits allow, never less than a start needs, and gives the space back to the disk."""

import asyncio
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from support.fake_zones import make_sample, make_update
from support.kept import Kept
from support.waiting import PATIENCE, until

from adapters.fields.times import written_time
from adapters.reading import Quality, Reading
from service.errors import CheckpointError
from service.store.checkpoint import Checkpoint
from service.store.journal import Journal
from service.store.postgres.database import PostgresDatabase
from service.store.retention import Limits, Stable, prune
from service.store.store import JOURNAL, Store

STEP = 300
FIRST = make_sample(0).time
DAY = 86_400
FOREVER = 1e12


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    with closing(Journal.open(tmp_path / JOURNAL)) as opened:
        yield opened


@pytest.fixture
def either(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> Iterator[Journal]:
    """A journal in a file or a database, whose limits on age are the same."""
    monkeypatch.setattr(PostgresDatabase, "least_pruned", 0)
    monkeypatch.setattr("service.store.journal.DELETED_AT_ONCE", 50)
    store = kept.open()
    for zone in ("living", "bedroom"):
        store.journal.claim(zone, "f")
    yield store.journal
    store.close()


def fill(journal: Journal, zone: str, steps: int, begin: int = FIRST, step: int = STEP) -> None:
    """Samples and history of `zone` from `begin` (UTC s) on."""
    for time in range(begin, begin + steps * step, step):
        journal.record(zone, make_update(0)._replace(time=time))
    journal.append_all([(zone, make_sample(0)._replace(time=begin + k * step)) for k in range(steps)])


def steps_of(journal: Journal, zone: str) -> tuple[list[int], list[int]]:
    """Which samples and which history rows of `zone` there are."""
    samples = [(item.time - FIRST) // STEP for item in journal.samples_after(zone, None)]
    return samples, [(row.time - FIRST) // STEP for row in journal.history(zone, None, None, 100_000)]


def pruned(journal: Journal, limits: Limits, oldest_checkpoint: int | None) -> int:
    """Prune with the oldest checkpoint of every zone after this step; how many slices that took."""
    time = None if oldest_checkpoint is None else FIRST + oldest_checkpoint * STEP
    return sum(1 for _ in prune(journal, lambda zone: time, limits))


def test_what_a_start_needs_stays_however_small_the_limits_are(journal: Journal) -> None:
    fill(journal, "living", 300)
    assert pruned(journal, Limits(10 * STEP, 10_000), oldest_checkpoint=None) < 20, "it comes to an end"
    assert steps_of(journal, "living")[0] == list(range(300))
    pruned(journal, Limits(0.0, 1), oldest_checkpoint=299)
    assert steps_of(journal, "living") == ([299], [299])
    assert not journal.append_all([("living", make_sample(299))]), "what is there is not taken twice"
    assert journal.append_all([("living", make_sample(300))])


def test_after_pruning_and_setting_aside_all_that_is_left_new_samples_are_sound(either: Journal) -> None:
    fill(either, "living", 300)
    pruned(either, Limits(100 * STEP, FOREVER), oldest_checkpoint=290)
    either.set_aside("living", FIRST)
    for step in (250, 251):
        assert either.append_all([("living", make_sample(step))])
    assert steps_of(either, "living") == ([250, 251], [])


def test_age_counts_from_the_newest_sample_of_each_zone(either: Journal) -> None:
    fill(either, "living", 50)
    fill(either, "bedroom", 300)
    pruned(either, Limits(100 * STEP, FOREVER), oldest_checkpoint=1000)
    assert steps_of(either, "living")[0] == list(range(50)), "it stopped long ago, and keeps its last 100 steps"
    assert steps_of(either, "bedroom")[0] == list(range(199, 300))


def test_a_clock_that_leaps_ahead_deletes_nothing(either: Journal) -> None:
    """500 days ahead for a minute, and whatever follows: the true rows stay until a day of samples has confirmed it."""
    fill(either, "living", 1000)
    ahead = FIRST + 500 * DAY
    fill(either, "living", 5, ahead)
    pruned(either, Limits(100 * STEP, FOREVER), oldest_checkpoint=10_000_000)
    assert steps_of(either, "living")[0][:1000] == list(range(1000))
    assert either.pruned_until("living") is None
    fill(either, "living", 290, ahead + 5 * STEP)
    for _ in range(2):
        pruned(either, Limits(100 * STEP, FOREVER), oldest_checkpoint=10_000_000)
    assert steps_of(either, "living")[0][0] == (ahead - FIRST) // STEP + 294 - 100, "that was a day of samples"


async def test_a_clock_that_is_led_on_step_by_step_deletes_nothing_before_a_day_has_gone_by(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A forged time server sets it by half an hour a minute: a day of samples comes in an hour."""
    store, wall, steady = Store(tmp_path), [FIRST + 1e6], [0.0]
    store.prune_seconds, store.clock_is_stable = 0.0, Stable(lambda: wall[0], lambda: steady[0])
    fill(store.journal, "living", 100)
    store.checkpoints.save("living", Checkpoint("f", FIRST + 1000 * STEP, {}, {}))

    async def looked_through(seconds: float, set_by: float) -> int:
        """The oldest sample, once the journal was looked through `seconds` after its clock was `set_by` s."""
        steady[0] += seconds
        wall[0] += seconds + set_by
        store.known_size = 0
        keeping = asyncio.create_task(store.keep_within(Limits(10.0 * 3600, FOREVER)))
        await until(lambda: store.known_size)
        keeping.cancel()
        return (await store.run(steps_of, store.journal, "living"))[0][0]

    for _ in range(2):
        # Each is too little, and both together are not.
        assert await looked_through(60.0, 2000.0) == 0
    await store.run(fill, store.journal, "living", 60, FIRST + 100 * STEP, 1800)
    assert await looked_through(60.0, 0.0) == 0
    assert await looked_through(DAY - 100.0, 0.0) == 0
    assert await looked_through(60.0, 0.0) > 0
    assert caplog.text.count("for a day no history is deleted for its age") == 1
    store.close()


def test_without_checkpoints_the_history_still_goes(either: Journal) -> None:
    fill(either, "living", 2500)
    for _ in range(2):
        pruned(either, Limits(100 * STEP, FOREVER), oldest_checkpoint=None)
    assert steps_of(either, "living") == (list(range(2500)), list(range(2399, 2500)))


def test_the_file_stays_within_its_limit_and_the_oldest_rows_go_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.store.journal_file.LOG_LIMIT", 2**20)
    limit = 2_000_000
    with closing(Journal.open(tmp_path / JOURNAL)) as journal:
        for round_ in range(8):
            for zone in ("living", "bedroom"):
                fill(journal, zone, 300, FIRST + 300 * round_ * STEP)
            pruned(journal, Limits(FOREVER, limit), oldest_checkpoint=300 * round_ + 290)
            assert journal.database.size() <= limit
            assert sum(path.stat().st_size for path in tmp_path.glob(f"{JOURNAL}*")) <= limit
    assert (tmp_path / JOURNAL).stat().st_size <= limit
    with closing(Journal.open(tmp_path / JOURNAL)) as again:
        living, bedroom = (steps_of(again, zone)[1] for zone in ("living", "bedroom"))
    assert living[-1] == bedroom[-1] == 2399
    assert living == list(range(living[0], 2400)), "nothing is missing in the middle"
    assert abs(living[0] - bedroom[0]) <= 500, "both gave the same"
    assert 300 < living[0] < 2390


def test_what_was_reset_goes_before_anything_else_with_its_readings(journal: Journal) -> None:
    fill(journal, "living", 1000)
    posted = [Reading("T_i", FIRST + k / 100, 20.0, Quality.GOOD) for k in range(10_000)]
    journal.append_all([], [("living", posted)])
    journal.forget("living")
    fill(journal, "living", 1000)
    needed = journal.database.size() - 700_000
    pruned(journal, Limits(FOREVER, needed), oldest_checkpoint=990)
    assert steps_of(journal, "living")[0] == list(range(1000))
    assert journal.database.size() < needed


def test_what_goes_for_its_age_goes_a_week_at_a_time_and_is_told(
    either: Journal, caplog: pytest.LogCaptureFixture
) -> None:
    """A clock that is wrong for a day must not cost the history of years."""
    fill(either, "living", 90, FIRST, DAY // 2)
    left = []
    for _ in range(6):
        pruned(either, Limits(10.0 * DAY, FOREVER), oldest_checkpoint=10_000_000)
        found = [either.first_time(table, "living") for table in ("samples", "history")]
        left.append([(first - FIRST) / DAY for first in found if first is not None])
    assert left == [[7, 7], [14, 14], [21, 21], [28, 28], [34.5, 34.5], [34.5, 34.5]]
    told = [record.getMessage() for record in caplog.records if "history older" in record.getMessage()]
    assert len(told) == 5
    first, last = (written_time(FIRST + days * DAY) for days in (0, 7))
    assert told[0] == f"history older than keep_history is deleted: of zone 'living' from {first} to {last}"


async def test_checkpoints_that_cannot_be_listed_keep_the_samples_of_their_zone_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    store = Store(tmp_path)
    for zone in ("bedroom", "living"):
        fill(store.journal, zone, 100)
        store.checkpoints.save(zone, Checkpoint("f", FIRST + 99 * STEP, {}, {}))
    listed = store.checkpoints.oldest

    def oldest(zone: str) -> int | None:
        if zone == "bedroom":
            raise CheckpointError("the checkpoints in bedroom cannot be listed (too many open files)")
        return listed(zone)

    monkeypatch.setattr(store.checkpoints, "oldest", oldest)
    keeping = asyncio.create_task(store.keep_within(Limits(10.0 * STEP, FOREVER)))
    # A journal is for one thread at a time, and here its store is at work.
    async with asyncio.timeout(PATIENCE):
        while (await store.run(steps_of, store.journal, "living"))[0][0] != 89:
            await asyncio.sleep(0.01)
    keeping.cancel()
    assert (await store.run(steps_of, store.journal, "bedroom"))[0] == list(range(100))
    store.close()
    assert "every sample of zone 'bedroom' stays in the journal: the checkpoints in" in caplog.text
