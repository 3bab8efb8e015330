"""What every store promises, held by each of them: SQLite in a folder, and PostgreSQL."""

import asyncio
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_zones import PERIOD, START, make_sample, make_update
from support.kept import Kept
from support.running_zone import Announced, fed, finished, make, plumbing, straight
from support.tables import tabled
from support.waiting import PATIENCE
from support.zone_samples import comparable, sample

from adapters.reading import Quality, Reading
from service.errors import JournalError, StateMismatch
from service.records.sample import Sample
from service.records.series import Stretch
from service.store.checkpoint import Checkpoint
from service.store.journal import REMEMBERED
from service.store.retention import Limits
from service.store.series import bucket_of

DAY = 86_400


def bits(item: Sample) -> tuple[Any, ...]:
    values = item.outputs.tobytes(), item.inputs.tobytes(), repr(float(item.setpoint))
    return item.time, values, item.output_quality, item.input_quality


async def test_a_sample_is_durable_when_append_returns_bit_for_bit_and_only_once(kept: Kept) -> None:
    # A NaN with a payload, the negative zero, the smallest number.
    odd = np.frombuffer(bytes.fromhex("010000000000f8ff") + np.array([-0.0, 5e-324]).tobytes())
    item = Sample(START, odd[:1], odd, (Quality.BAD,), (Quality.BAD, Quality.GOOD, Quality.UNCERTAIN), np.float64(20.5))
    none = Sample(START + 1, odd[:0], odd[:0], (), ())
    async with kept.opened() as store:
        await store.append("z", item)
        await store.append("z", item._replace(outputs=np.array([99.0])))
        await store.append("z", none)
        await store.append("z", item)

    async with kept.opened() as store:
        assert [bits(one) for one in await store.samples_after("z", None)] == [bits(item), bits(none)]


async def test_one_who_is_stopped_does_not_take_the_commit_of_the_others_along(kept: Kept) -> None:
    async with kept.opened("ab") as store:
        stopped = asyncio.create_task(store.append("a", sample(0)))
        waiting = asyncio.create_task(store.append("b", sample(0)))
        await asyncio.sleep(0)
        stopped.cancel()
        await waiting
        assert stopped.cancelled()
        assert await store.run(store.journal.last_sample_time, "b") == sample(0).time


async def test_samples_come_back_in_pages_and_in_order_without_the_skipped_ones(kept: Kept) -> None:
    async with kept.opened() as store:
        await asyncio.gather(*(store.append("z", make_sample(step)) for step in range(1200)))
        await store.run(store.journal.skip, "z", make_sample(3).time, "failed 3 times: it's broken")
        with pytest.raises(JournalError, match=r"no sample of zone 'z' at 7 to skip"):
            await store.run(store.journal.skip, "z", 7, "there is none")
    async with kept.opened() as store:
        found: list[Sample] = []
        while page := await store.samples_after("z", found[-1].time if found else None):
            found += page
        ahead = await store.run(store.journal.samples_ahead, "z", make_sample(1000).time)
        nobody = len(await store.samples_after("nobody", None))
    assert [item.time for item in found] == [make_sample(step).time for step in range(1200) if step != 3]
    assert (ahead, nobody) == (199, 0)


async def test_an_older_sample_is_passed_over_and_the_chain_goes_on_after_each_opening(kept: Kept) -> None:
    for steps in ([0, 1, 2], [1, 3], [3, 2, 4]):
        async with kept.opened() as store:
            for step in steps:
                await store.append("z", make_sample(step))
    async with kept.opened() as store:
        found = await store.samples_after("z", make_sample(0).time)
    assert [item.time for item in found] == [make_sample(step).time for step in (1, 2, 3, 4)]


async def test_history_is_seen_at_once_and_outlives_the_store(kept: Kept) -> None:
    first = make_update(0)._replace(score=None, y=(float("nan"),), log_likelihood=-0.0, setpoint=21.5)
    async with kept.opened() as store:
        store.record("z", make_update(0))
        seen = len(await store.run(store.journal.history, "z", None, None, 10))
        store.record("z", first)
        for step in range(1, 150):
            store.record("z", make_update(step))
        unread = len(await store.run(store.journal.history, "other", None, None, 10))
        assert (seen, unread) == (1, 0)

    async with kept.opened() as store:
        early = await store.run(store.journal.history, "z", None, START + 2 * PERIOD, 10)
        newest = await store.run(store.journal.history, "z", None, None, 3)
        middle = await store.run(store.journal.history, "z", START + 4 * PERIOD, START + 6 * PERIOD, 10)
    assert [row.time for row in early] == [START, START + PERIOD]
    assert (early[0].log_likelihood, early[0].setpoint) == (0.0, 21.5)
    assert np.isnan(early[0].y)
    assert np.isnan(early[0].mean)
    assert repr(early[1]) == repr(type(early[1]).of(make_update(1)))
    assert [row.time for row in newest] == [START + step * PERIOD for step in (147, 148, 149)]
    assert [row.time for row in middle] == [START + step * PERIOD for step in (4, 5)]


@pytest.mark.parametrize("page", [7, 4000])
async def test_a_series_is_thinned_and_hides_no_extreme(kept: Kept, page: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.store.journal.SERIES_ROWS", page)
    there = [*range(40), *range(60, 120)]
    async with kept.opened() as store:
        end = START + 120 * PERIOD
        stretch = Stretch("z", START, end, PERIOD, bucket_of(START, end, PERIOD, 30), 3)
        empty = await store.series(stretch)
        assert (empty.times.size, empty.inputs.shape) == (0, (0, 3))
        await asyncio.gather(*(store.append("z", make_sample(step)) for step in there))
        for step in there:
            store.record("z", make_update(step))
        found = await store.series(stretch)
    assert len(found.times) <= 30
    for index, begin in enumerate(found.times.tolist()):
        steps = [s for s in there if begin <= START + s * PERIOD < begin + found.bucket]
        assert steps, "a gap is no bucket"
        y = [make_update(step).y[0] for step in steps]
        assert found.means["y"][index] == pytest.approx(np.mean(y))
        assert (found.y_low[index], found.y_high[index]) == (min(y), max(y))
    assert np.isnan(found.inputs[:, 1]).all(), "what was not measured has no mean"


@tabled
async def test_a_damaged_or_missing_sample_is_told(kept: Kept, statement: str) -> None:
    async with kept.opened("zy") as store:
        for step in range(10):
            await store.append("z", make_sample(step))
            await store.append("y", make_sample(10 + step))
        kept.change(f"{statement} WHERE time = {make_sample(5).time}")
        with pytest.raises(JournalError, match=r"damaged sample of zone 'z' at .*(--reset z|by SQL)"):
            await store.samples_after("z", make_sample(2).time)
        assert len(await store.samples_after("z", make_sample(7).time)) == 2, "what is not needed is not asked for"
        assert len(await store.samples_after("y", None)) == 10, "the other zone is sound"


async def test_a_damaged_row_of_history_is_left_out_and_told_once(kept: Kept, caplog: pytest.LogCaptureFixture) -> None:
    async with kept.opened() as store:
        for step in range(6):
            await store.append("z", make_sample(step))
            store.record("z", make_update(step))
        await store.run(store.journal.flush)
        kept.change(f"UPDATE {{}}history SET gate = gate + 0.001 WHERE time = {make_sample(4).time}")
        for _ in range(3):
            rows = await store.run(store.journal.history, "z", None, None, 100)
            assert [row.time for row in rows] == [make_sample(step).time for step in (0, 1, 2, 3, 5)]
        found = await store.series(Stretch("z", START, START + 6 * PERIOD, PERIOD, PERIOD, 3))
        assert np.isnan(found.means["y"]).tolist() == [step == 4 for step in range(6)]
    assert caplog.text.count("damaged history row of zone 'z'") == 1


READINGS = [Reading("z/T_i", START + 0.5, np.float64(21.5)), Reading("z/u", START + 1.0, -0.0, Quality.UNCERTAIN)]


async def test_readings_are_kept_once_until_they_are_too_old_to_be_posted_again(kept: Kept) -> None:
    async with kept.opened() as store:
        await store.keep("z", READINGS)
        await store.keep("z", [READINGS[0]._replace(value=3.0), Reading("z/T_i", START + 2.0, 22.0)])
        await store.keep("z", [])
    async with kept.opened() as store:
        all_of_them = await store.run(store.journal.kept, "z", 0.0)
        between = await store.run(store.journal.kept, "z", START + 1.0, START + 1.5)
        nobody = await store.run(store.journal.kept, "nobody", 0.0, inf)
    assert all_of_them == [*READINGS, Reading("z/T_i", START + 2.0, 22.0)], "the first one stays"
    assert (between, nobody) == ([READINGS[1]], [])
    async with kept.opened() as store:
        left = []
        for time in (START + REMEMBERED, START + 1 + REMEMBERED):
            await store.append("z", make_sample(0)._replace(time=time))
            left.append(len(await store.run(store.journal.kept, "z", 0.0)))
        assert left == [3, 2]


async def test_readings_and_samples_of_many_zones_share_commits(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    """One value that fifty rooms ask for takes a commit or two, and not fifty."""
    zones = "abcdefgh"
    async with kept.opened(zones) as store:
        commits, append_all = [], store.journal.append_all
        monkeypatch.setattr(store.journal, "append_all", lambda *told: commits.append(told) or append_all(*told))
        await asyncio.gather(*(store.keep(zone, READINGS) for zone in zones), store.append("a", make_sample(0)))
        assert len(commits) <= 2
        for zone in zones:
            assert len(await store.run(store.journal.kept, zone, 0.0)) == 2
        assert await store.run(store.journal.last_sample_time, "a") == make_sample(0).time


@pytest.mark.parametrize("change", ["value = value + 1", "quality = 'uncertain'", "channel = 'z/X'", "time = time - 1"])
async def test_a_damaged_reading_is_left_out_and_told(
    kept: Kept, change: str, caplog: pytest.LogCaptureFixture
) -> None:
    async with kept.opened() as store:
        await store.keep("z", READINGS)
        kept.change(f"UPDATE {{}}readings SET {change} WHERE channel = 'z/T_i'")
        assert (await store.run(store.journal.kept, "z", 0.0)) == [READINGS[1]]
    assert "damaged reading of zone 'z'" in caplog.text


def checkpoint(step: int, fingerprint: str = "f") -> Checkpoint:
    return Checkpoint(fingerprint, step, {"x": np.arange(5.0) + step, "n": np.array(3)}, {"a": [1, None]}, {"b": "c"})


async def test_the_newest_three_checkpoints_are_kept_whole_and_a_damaged_one_is_passed_over(
    kept: Kept, caplog: pytest.LogCaptureFixture
) -> None:
    async with kept.opened() as store:
        assert store.checkpoints.load("z", "f") is None
        before = store.checkpoints.oldest("z")
        for step in (100, 200, 300, 400):
            store.checkpoints.save("z", checkpoint(step))
        assert (before, store.checkpoints.oldest("z")) == (None, 200)

    async with kept.opened() as store:
        with pytest.raises(StateMismatch):
            store.checkpoints.load("z", "another")
        found = store.checkpoints.load("z", "f")
        assert (found.step, found.meta, found.about, found.zone) == (400, {"a": [1, None]}, {"b": "c"}, "z")
        np.testing.assert_array_equal(found.arrays["x"], np.arange(5.0) + 400)
        kept.damage_checkpoint(400)
        for _ in range(2):
            assert store.checkpoints.load("z", "f").step == 300
    assert caplog.text.count("is damaged") == 1


async def test_stored_samples_belong_to_one_network(kept: Kept) -> None:
    async with kept.opened() as store:
        await store.claim("z", "another")
        await store.claim("z", "f")
        await store.append("z", make_sample(0))
    async with kept.opened() as store:
        with pytest.raises(StateMismatch, match=r"zone 'z': the stored state in .* belongs to another network"):
            await store.claim("z", "another")


async def test_a_zone_is_forgotten_whole_and_begins_anew(kept: Kept) -> None:
    async with kept.opened() as store:
        await store.claim("other", "f")
        await store.append("z", make_sample(5))
        await store.append("other", make_sample(5))
        store.record("z", make_update(5))
        await store.keep("z", READINGS)
        store.checkpoints.save("z", checkpoint(make_sample(5).time))
        await store.forget("z")
    async with kept.opened("") as store:
        await store.claim("z", "another")
        assert await store.samples_after("z", None) == []
        assert await store.run(store.journal.history, "z", None, None, 9) == []
        assert await store.run(store.journal.kept, "z", 0.0) == []
        assert store.checkpoints.load("z", "f") is None
        assert await store.run(store.journal.last_sample_time, "z") is None
        await store.append("z", make_sample(0))
        assert [len(await store.samples_after(zone, None)) for zone in ("z", "other")] == [1, 1]


async def test_what_lies_ahead_is_set_aside(kept: Kept) -> None:
    now = make_sample(5).time
    async with kept.opened() as store:
        for step in range(10):
            await store.append("z", make_sample(step))
            store.record("z", make_update(step))
        for step in (2, 7):
            store.checkpoints.save("z", checkpoint(make_sample(step).time))
        await store.keep("z", [Reading("z/T_i", now + 5000.0, 1.0)])
        ahead = await store.run(store.journal.samples_ahead, "z", now)
        await store.set_back("z", checkpoint(make_sample(9).time), checkpoint(now), now)
        assert ahead == 4

    async with kept.opened() as store:
        found = store.checkpoints.load("z", "f")
        newest = await store.run(store.journal.last_sample_time, "z")
        readings = await store.run(store.journal.kept, "z", 0.0)
        history = await store.run(store.journal.history, "z", None, None, 100)
        await store.append("z", make_sample(6))
        samples = await store.samples_after("z", None)
        assert (found and found.step, newest, len(readings), len(history), len(samples)) == (now, now, 0, 6, 7)


async def test_it_is_kept_within_its_limits_while_it_is_written_to(
    kept: Kept, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps, needed = 12 * 48, make_sample(500).time
    async with kept.opened("ab") as store:
        monkeypatch.setattr(type(store.journal.database), "least_pruned", 0)
        for zone in "ab":
            await asyncio.gather(*(store.append(zone, make_sample(step)) for step in range(steps)))
            store.checkpoints.save(zone, checkpoint(make_sample(steps - 1).time if zone == "a" else needed))
        pruning = asyncio.create_task(store.keep_within(Limits(DAY / 4, 1e12)))
        async with asyncio.timeout(PATIENCE):
            while (await store.samples_after("b", None))[0].time <= needed:
                assert not pruning.done()
                await store.append("a", make_sample(steps := steps + 1))
        pruning.cancel()
    async with kept.opened("ab") as store:
        first = (await store.samples_after("b", None))[0]
        await store.append("b", make_sample(steps))
        assert await store.resume_after("a", None) == make_sample(steps).time
    assert first.time == needed + PERIOD, "what follows the oldest checkpoint stays"
    assert "it has learned anew from the later ones" in caplog.text, "the pruned samples were no part of any checkpoint"


async def test_a_zone_runs_on_it_and_goes_on_bit_for_bit(kept: Kept, tmp_path: Path) -> None:
    items = [sample(k) for k in range(60)]
    announcer = Announced()
    for part, saved in ((items[:25], 1e9), (items[25:50], 1e-9), (items[50:], 1e9)):
        async with plumbing(tmp_path, announcer, saved, store=kept.open()) as shared:
            zone = make(shared)
            await finished(zone, await fed(zone, part))
    announced = [comparable(update) for _, update in announcer.updates]
    assert list(dict.fromkeys(announced)) == straight(items), "what was restored is announced once more"
    async with kept.opened("") as store:
        assert len(await store.run(store.journal.history, "z", None, None, 100)) == 60
        await store.claim("z", "mark")
        await asyncio.to_thread(store.checkpoints.set_aside, "z", 0)
    async with plumbing(tmp_path, announcer, store=kept.open()) as shared:
        await finished(zone := make(shared), await fed(zone, []))
    assert comparable(announcer.updates[-1][1]) == announced[-1], "without its checkpoints it learns from the journal"
