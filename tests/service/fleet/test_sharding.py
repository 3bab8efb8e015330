"""Zones on shards: evenly, always the same, and as few moves as there can be."""

from collections import Counter
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from support import sites
from support.campus import posted, told_by_clients

from service.config.load import load
from service.fleet.plan import Plan, shard_names
from service.fleet.sharding import keys, lopsided, owners

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
def test_a_shard_that_is_added_or_removed_moves_no_other_zone(shards: int) -> None:
    names = shard_names(shards + 1)
    before, after = owners(ZONES, names[:-1]), owners(ZONES, names[::-1])
    moved = [zone for zone in ZONES if before[zone] != after[zone]]
    assert {after[zone] for zone in moved} == {names[-1]}
    share = len(ZONES) / (shards + 1)
    assert abs(len(moved) - share) <= 6 * sqrt(share)
    without = owners(ZONES, names[1:])
    assert {zone for zone in ZONES if after[zone] != without[zone]} == {z for z in ZONES if after[z] == names[0]}


def test_zones_that_read_from_one_device_share_a_shard_and_others_go_by_themselves(tmp_path: Path) -> None:
    line = {"kind": "modbus", "first_register": 0, "type": "int16"}
    devices: dict[str, Any] = {name: line | {"host": f"{name}.example"} for name in ("alpha", "beta", "gamma")}
    registers = {name: {"register": place} for place, name in enumerate(sites.UNITS)}
    rooms = {"a1": ("alpha", "alpha"), "a2": ("alpha", "alpha"), "b1": ("beta", "beta"), "b2": ("gamma", "beta")}
    zones = [
        sites.zone(room, own, registers | {"T_out": {"source": shared, "register": 9}})
        for room, (own, shared) in rooms.items()
    ]
    zones.append(posted("posted", 600))
    config = load(sites.written(tmp_path, {**devices, "clients": {"kind": "http"}}, zones))
    assert keys(config) == {
        "a1": "source/alpha",
        "a2": "source/alpha",
        "b1": "source/beta",
        "b2": "source/beta",
        "posted": "posted",
    }
    (warning,) = lopsided(config, 4)
    assert "sources.beta" in warning or "sources.alpha" in warning
    assert lopsided(config, 2) == []


def test_every_shard_has_a_name_of_its_own_at_a_broker(tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    zones = "".join(
        told_by_clients(f"room-{n}", 600).replace('source = "clients"', f'source = "broker", topic = "t{n}"')
        for n in range(20)
    )
    fleet = '[zenoh]\nenabled = false\n[fleet]\ndatabase = "postgresql://a@b/c"\nshards = 3\n'
    path.write_text(
        f'[site]\nid = "campus"\n{fleet}[sources.broker]\nkind = "mqtt"\nhost = "broker.example"\n{zones}',
        encoding="utf-8",
    )
    plan = Plan(1, load(path))
    parts = {shard: plan.share(shard) for shard in plan.shards}
    assert sorted(zone.id for part in parts.values() for zone in part.zones) == sorted(f"room-{n}" for n in range(20))
    names = {shard: part.sources["broker"].client_id for shard, part in parts.items()}
    assert names == {shard: f"thermogate-campus-broker-{shard}" for shard in shard_names(3)}
