"""What is posted while a shard goes over to another plan is taken by every zone, or asked for again."""

import asyncio
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import pytest
from support.campus import small_site, told_by_clients

from adapters.http.posted import Posted
from adapters.reading import Reading
from service.config.load import load
from service.daemon.supply.feeds import Feed, Tally
from service.records.receipt import Receipt

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.errors import Away
from service.fleet import peers
from service.fleet.shards.shard import Shard

ZONES = ("posted", "attic")


class Slow:
    """A zone, and what happens while it makes readings durable."""

    def __init__(self) -> None:
        self.taken: list[Reading] = []
        self.meanwhile: Callable[[], object] = lambda: None

    @property
    def intake(self) -> Self:
        """Of the zone that this stands for."""
        return self

    async def take(self, source: str, readings: Sequence[Reading]) -> Receipt:
        await asyncio.sleep(0)
        self.meanwhile()
        repeated = sum(reading in self.taken for reading in readings)
        self.taken += readings
        return Receipt(len(readings) - repeated, repeated, 0, Counter())


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Shard, dict[str, Any]]:
    """A shard with two zones that one source posts to, and these zones."""
    path = small_site(tmp_path)
    path.write_text(path.read_text(encoding="utf-8") + told_by_clients("attic", 600), encoding="utf-8")
    monkeypatch.setattr(peers, "own_node", lambda: "0123456789abcdef")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    shard, zones = Shard("campus", "shard-0"), {name: Slow() for name in ZONES}
    feed = Feed("clients", load(path), zones, ZONES, Tally())
    shard._work = SimpleNamespace(zones=zones, runtime=SimpleNamespace(feeds=[feed]))
    shard.version = 1
    return shard, zones


def post(shard: Shard) -> Any:
    return shard.take([Posted(f"{zone}/T_i", 20.0, 600.0) for zone in ZONES], None, set(ZONES))


def test_a_zone_that_leaves_meanwhile_has_the_post_repeated(scene: tuple[Shard, dict[str, Any]]) -> None:
    shard, zones = scene
    first, left = zones["posted"], zones["attic"]
    first.meanwhile = lambda: zones.pop("attic")
    with pytest.raises(Away, match="'attic' is being moved"):
        asyncio.run(post(shard))
    # It is back, as it is in the shard that has it next.
    first.meanwhile, zones["attic"] = lambda: None, left
    receipt = asyncio.run(post(shard))
    assert receipt.accepted + receipt.repeated == 2
    assert all(zone.taken for zone in zones.values())


@pytest.mark.parametrize("change", [("version", 2), ("adopting", True)])
def test_a_plan_that_is_adopted_meanwhile_has_the_post_repeated(
    scene: tuple[Shard, dict[str, Any]], change: tuple[str, Any]
) -> None:
    shard, zones = scene
    zones["posted"].meanwhile = lambda: setattr(shard, *change)
    with pytest.raises(Away, match="post the readings again"):
        asyncio.run(post(shard))
