"""Charts of the journal: buckets, pages, gaps, damage."""

from __future__ import annotations

from support.fake_zones import PERIOD, START

from service.records.series import Stretch
from service.store.series import bucket_of


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
