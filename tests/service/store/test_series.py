"""Charts of the journal: buckets, pages, gaps, damage."""

from __future__ import annotations

import asyncio
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from support.fake_zones import PERIOD, START, make_sample, make_update

from service.records.series import Series, Stretch
from service.store.series import bucket_of
from service.store.store import JOURNAL, Store


def filled(folder: Path, steps: range, missing: frozenset[int] = frozenset()) -> None:
    async def fill() -> None:
        store = Store(folder)
        try:
            await store.claim("z", "f")
            for step in steps:
                if step not in missing:
                    await store.append("z", make_sample(step))
                    store.record("z", make_update(step))
            await store.write(store.journal.flush)
        finally:
            store.close()

    asyncio.run(fill())


def read(folder: Path, start: int, end: int, points: int) -> Series:
    """A stretch from step `start` to step `end`."""

    async def ask() -> Series:
        store = Store(folder)
        try:
            first, last = START + start * PERIOD, START + end * PERIOD
            return await store.series(Stretch("z", first, last, PERIOD, bucket_of(first, last, PERIOD, points), 3))
        finally:
            store.close()

    return asyncio.run(ask())


def test_a_short_stretch_is_every_sample(tmp_path: Path) -> None:
    filled(tmp_path, range(20))
    found = read(tmp_path, 5, 15, 100)
    assert (found.bucket, found.times.tolist()) == (PERIOD, [START + step * PERIOD for step in range(5, 15)])
    updates = [make_update(step) for step in range(5, 15)]
    np.testing.assert_allclose(found.means["y"], [update.y[0] for update in updates], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.y_low, found.y_high)
    np.testing.assert_array_equal(found.band_low, [u.score.lower[0] for u in updates if u.score])
    np.testing.assert_allclose(found.inputs[:, 0], [5.0 + 0.1 * step for step in range(5, 15)])
    assert np.isnan(found.inputs[:, 1]).all(), "what was not measured has no mean"


def test_a_gap_is_no_bucket(tmp_path: Path) -> None:
    filled(tmp_path, range(100), missing=frozenset(range(40, 60)))
    found = read(tmp_path, 0, 100, 200)
    steps = ((found.times - START) // PERIOD).tolist()
    assert steps == [*range(40), *range(60, 100)]


def test_a_zone_without_history_has_an_empty_series(tmp_path: Path) -> None:
    filled(tmp_path, range(0))
    found = read(tmp_path, 0, 10, 50)
    assert found.times.size == 0
    assert found.inputs.shape == (0, 3)


def test_a_damaged_row_is_left_out_and_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    filled(tmp_path, range(10))
    connection = sqlite3.connect(tmp_path / JOURNAL)
    with connection:
        connection.execute("UPDATE history SET y = 1e200 WHERE time = ?", (START + 3 * PERIOD,))
        connection.execute("UPDATE history SET y = 'warm' WHERE time = ?", (START + 4 * PERIOD,))
        connection.execute("UPDATE samples SET inputs = x'00' WHERE time = ?", (START + 3 * PERIOD,))
    connection.close()
    found = read(tmp_path, 0, 10, 50)
    assert np.isnan(found.means["y"]).sum() == 1, "the accepted sample of step 4 is still there"
    assert found.y_high[np.isfinite(found.y_high)].max() < 30
    assert START + 3 * PERIOD not in found.times.tolist()
    assert caplog.text.count("damaged history row") == 2


def test_a_stretch_of_millions_of_samples_is_read_in_strides() -> None:
    second = Stretch("z", 0, 365 * 86400, 1, 86400, 3)
    assert (365 * 86400) // second.stride <= 600_000
    assert Stretch("z", 0, 365 * 86400, 300, 86400, 3).stride == 1


def test_buckets_are_whole_periods_and_few_enough() -> None:
    for points in (10, 100, 999):
        for length in (3600, 86400, 365 * 86400):
            bucket = bucket_of(START, START + length, PERIOD, points)
            assert bucket % PERIOD == 0
            assert length / bucket + 1 <= points or bucket == PERIOD
