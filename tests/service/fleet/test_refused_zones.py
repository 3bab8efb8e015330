"""Zones that a shard cannot run are refused one by one, and held by nobody."""

from __future__ import annotations

import asyncio
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
from service.store.postgres.leases import Leases
from service.store.postgres.store import PostgresStore

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.fleet.shards.crashes import MOST, Suspect
from service.fleet.shards.shard import _sound

SITE = f"refused-{os.getpid()}"


def test_a_zone_that_is_refused_can_be_taken_by_another_shard(tmp_path: Path, postgres_server: Server) -> None:
    path = small_site(tmp_path, count=3, shards=2, site=SITE, lease=2.0)
    config = load(path)
    path.write_text(path.read_text(encoding="utf-8").replace('"ekf"', '"arx"', 1), encoding="utf-8")
    changed = load(path)
    leases = Leases(postgres_server.connection, SITE)
    first, second = (
        PostgresStore(postgres_server.connection, SITE, leases.acquire(name, name, 600.0)) for name in ("a", "b")
    )
    innocent: Any = SimpleNamespace(guilty={})
    blamed: Any = SimpleNamespace(guilty={"room-0000": Suspect("room-0000", 600, MOST)})

    async def use() -> None:
        own: Any = SimpleNamespace(store=first)
        sound, refused = await _sound(config, "shard-0", own, innocent)
        assert (sound.zones, refused) == (config.zones, {})
        await first.append("room-0001", make_sample(1))
        for zone in config.zones:
            await first.give_up(zone.id)
        sound, refused = await _sound(changed, "shard-0", own, blamed)
        assert refused.keys() == {"room-0000", "room-0001"}
        assert "quarantine" in refused["room-0000"]
        assert "belongs to another network" in refused["room-0001"]
        assert [zone.id for zone in sound.zones] == ["room-0002", "posted"]
        for zone in config.zones[:2]:
            await second.claim(zone.id, fingerprint(zone))

    try:
        asyncio.run(use())
    finally:
        first.close()
        second.close()
        leases.close()
