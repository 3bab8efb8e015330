"""Zones on shards: evenly, always the same, and as few moves as there can be."""

from __future__ import annotations

from collections import Counter
from math import sqrt

import pytest

from service.fleet.plan import shard_names
from service.fleet.sharding import owners

ZONES = [f"room-{number}" for number in range(6000)]


@pytest.mark.parametrize("shards", [1, 2, 7, 32])
def test_every_shard_has_its_share(shards: int) -> None:
    counts = Counter(owners(ZONES, shard_names(shards)).values())
    share = len(ZONES) / shards
    assert sum(counts.values()) == len(ZONES)
    # Six standard deviations of a binomial distribution.
    assert all(abs(counts[name] - share) <= 6 * sqrt(share) for name in shard_names(shards))


def test_the_shard_of_a_zone_is_the_same_on_every_machine_and_in_every_version() -> None:
    known = {"room-0": "shard-3", "room-1": "shard-3", "attic": "shard-3", "zürich-9": "shard-4", "room-7": "shard-4"}
    assert owners(list(known), shard_names(5)) == known


@pytest.mark.parametrize("shards", [1, 4, 9])
def test_a_shard_that_is_added_takes_zones_and_no_other_zone_moves(shards: int) -> None:
    before, after = owners(ZONES, shard_names(shards)), owners(ZONES, shard_names(shards + 1))
    moved = [zone for zone in ZONES if before[zone] != after[zone]]
    assert {after[zone] for zone in moved} == {f"shard-{shards}"}
    share = len(ZONES) / (shards + 1)
    assert abs(len(moved) - share) <= 6 * sqrt(share)


def test_a_shard_that_is_removed_leaves_its_zones_and_no_other_zone_moves() -> None:
    left = [name for name in shard_names(6) if name != "shard-2"]
    before, after = owners(ZONES, shard_names(6)), owners(ZONES, left)
    assert {zone for zone in ZONES if before[zone] != after[zone]} == {
        zone for zone in ZONES if before[zone] == "shard-2"
    }


def test_the_order_in_which_shards_are_named_does_not_matter() -> None:
    assert owners(ZONES[:100], shard_names(5)) == owners(ZONES[:100], shard_names(5)[::-1])
