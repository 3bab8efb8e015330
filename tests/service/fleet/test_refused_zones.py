"""Zones that a shard cannot run are refused one by one, and held by nobody."""

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support.campus import small_site
from support.fake_zones import make_sample
from support.postgres import Server

from service.config.fitting import fingerprint
from service.config.load import load
from service.daemon.supply.feeds import narrowed
from service.store.postgres.leases import Leases
from service.store.postgres.store import PostgresStore

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.fleet.shards.crashes import MOST, Suspect
from service.fleet.shards.shard import claimed

SITE = f"refused-{os.getpid()}"


async def test_a_zone_that_is_refused_can_be_taken_by_another_shard(tmp_path: Path, postgres_server: Server) -> None:
    path = small_site(tmp_path, count=3, shards=2, site=SITE, lease=2.0)
    config = load(path)
    path.write_text(path.read_text(encoding="utf-8").replace('"ekf"', '"arx"', 1), encoding="utf-8")
    changed = load(path)
    leases = Leases(postgres_server.connection, SITE)
    first, second = (
        PostgresStore(postgres_server.connection, SITE, leases.acquire(name, name, 600.0)) for name in ("a", "b")
    )
    innocent: Any = SimpleNamespace(guilty={})
    try:
        sound, refused, waiting = await claimed(config, SimpleNamespace(store=first), innocent)
        assert (sound.zones, refused, waiting) == (config.zones, {}, frozenset())
        await first.append("room-0001", make_sample(1))
        for zone in (config.zones[0], config.zones[1], config.zones[3]):
            await first.give_up(zone.id)
        other: Any = SimpleNamespace(store=second)
        sound, refused, waiting = await claimed(changed, other, innocent)
        assert waiting == {"room-0002"}, "its shard has not let go of it yet"
        assert refused.keys() == {"room-0001"}
        assert "belongs to another network" in refused["room-0001"]
        assert [zone.id for zone in sound.zones] == ["room-0000", "posted"]
        await first.claim("room-0001", fingerprint(config.zones[1]))
        await first.give_up("room-0002")
        sound, refused, waiting = await claimed(changed, other, None, sound)
        assert (len(sound.zones), refused, waiting) == (3, {}, {"room-0001"})
        own: Any = SimpleNamespace(store=first)
        for step in range(2, MOST + 3):
            time = make_sample(step).time
            await first.claim("room-0001", fingerprint(config.zones[1]))
            await first.append("room-0001", make_sample(step))
            blamed: Any = SimpleNamespace(guilty={"room-0001": Suspect("room-0001", time, MOST)})
            _, refused, _ = await claimed(narrowed(config, ["room-0001"]), own, blamed)
            assert bool(refused) == (step == MOST + 2)
            assert len(await first.samples_after("room-0001", None)) == 1, "the one of before"
        assert "3 processes ended" in refused["room-0001"]
        assert "it was like that with 3 others of a day" in refused["room-0001"]
    finally:
        first.close()
        second.close()
        leases.close()
