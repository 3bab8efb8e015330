"""What the reader keeps survives a reload: a live source cannot be read a second time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from support.waiting import until

from adapters.errors import SourceConfigError
from adapters.reading import Batch, Reading
from service.config.load import load
from service.config.site import Config

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.errors import Away
from service.fleet import reader as module
from service.fleet.messages import Ack
from service.fleet.plan import Plan, shard_names
from service.fleet.reader import Reader


class Broker:
    """A live source that delivers what it is given, or gives up."""

    name = "bms"

    def __init__(self) -> None:
        self.given: asyncio.Queue[Batch | None] = asyncio.Queue()
        self.bound: list[str] = []

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        while (batch := await self.given.get()) is not None:
            yield batch
        raise SourceConfigError("sources.bms: the broker refuses this client")

    async def close(self) -> None:
        pass


class Shard:
    """The other end. The interval from 0 on is open: nothing is durable."""

    def __init__(self) -> None:
        self.boot, self.version, self.away = "first", 1, False
        self.got: list[tuple[float, set[str]]] = []

    async def ask(self, method: str, source: str, boot: str, *arguments: Any, timeout: float | None = None) -> Ack:
        await asyncio.sleep(0)
        if self.away:
            raise Away("it is being started")
        if method == "deliver" and boot == self.boot:
            plan, batch, _ = arguments
            if plan != self.version:
                raise Away("plans differ")
            self.got.append((batch.now, {reading.channel.split("/")[0] for reading in batch.readings}))
        return Ack(self.boot, self.version, 0.0)

    def times(self, zone: str) -> list[float]:
        return [now for now, zones in self.got if zone in zones]


class Scene:
    """A reader, the sources that it built, and shards."""

    def __init__(self, folder: Path, shards: int) -> None:
        self.folder = folder
        self.built: list[Broker] = []
        self.shards = {name: Shard() for name in shard_names(2)}
        self.reader = Reader("campus", "reader")
        peer: Any = self.shards.__getitem__
        self.reader._peer = peer  # type: ignore[method-assign]
        self.plan = Plan(1, self.site("abcdef"), shard_names(shards))

    def site(self, zones: Sequence[str], broker: str = "tcp/127.0.0.1:7") -> Config:
        text = f"""
            [site]
            id = "campus"
            [zenoh]
            enabled = false
            [fleet]
            database = "postgresql://db/x"
            [sources.bms]
            kind = "zenoh"
            connect = ["{broker}"]
        """
        for zone in zones:
            text += f"""
                [[zones]]
                id = "{zone}"
                period = 600
                network = "tite"
                estimator = "ekf"
                [zones.channels]
                T_i = {{ source = "bms", key = "{zone}/T", unit = "degC" }}
                T_out = {{ source = "bms", key = "roof/T", unit = "degC" }}
                u_heat = {{ source = "bms", key = "{zone}/u", unit = "W" }}
            """
        path = self.folder / "site.toml"
        path.write_text(text, encoding="utf-8")
        return load(path)

    async def adopt(self, plan: Plan) -> None:
        self.plan = plan
        for shard in self.shards.values():
            shard.version = plan.version
        await self.reader.adopt(plan)

    def tell(self, *times: float) -> None:
        for time in times:
            readings = [Reading(f"{zone.id}/T_i", time, 20.0) for zone in self.plan.config.zones]
            self.built[-1].given.put_nowait(Batch(readings, time))


@pytest.fixture
def brokers(monkeypatch: pytest.MonkeyPatch) -> list[Broker]:
    """The sources that were built."""
    built: list[Broker] = []

    def build(config: Config, name: str) -> Broker:
        built.append(Broker())
        config.rebind_source(name, built[-1])  # type: ignore[arg-type]
        return built[-1]

    def rebind(config: Config, name: str, source: Broker) -> None:
        source.bound = [binding.id for binding in config.bindings(name)]

    monkeypatch.setattr(Config, "build_source", build)
    monkeypatch.setattr(Config, "rebind_source", rebind)
    monkeypatch.setattr(module, "own_node", lambda: "0123456789abcdef")
    monkeypatch.setattr(module, "configure_logging", lambda table: None)
    monkeypatch.setattr("service.fleet.lines.AGAIN", 0.01)
    monkeypatch.setattr("service.fleet.lines.LOOK", 0.02)
    return built


async def started(folder: Path, brokers: list[Broker], shards: int = 1) -> Scene:
    """A reader whose shards have taken three batches."""
    scene = Scene(folder, shards)
    scene.built = brokers
    await scene.adopt(scene.plan)
    scene.tell(10.0, 20.0, 30.0)
    await until(lambda: all(len(scene.shards[name].got) == 3 for name in scene.plan.shards))
    return scene


@pytest.mark.parametrize("broker", ["tcp/127.0.0.1:7", "tcp/127.0.0.1:8"])
def test_a_shard_that_starts_anew_during_a_reload_gets_what_is_not_durable(
    broker: str, tmp_path: Path, brokers: list[Broker]
) -> None:
    async def scenario() -> None:
        scene = await started(tmp_path, brokers)
        shard = scene.shards["shard-0"]
        shard.away, shard.got = True, []
        scene.tell(40.0)
        await until(lambda: scene.built[0].given.empty())
        await scene.adopt(scene.plan.followed_by(scene.site("abcdefg", broker)))
        scene.tell(50.0)
        shard.boot, shard.away = "second", False
        await until(lambda: shard.times("g") == [50.0])
        assert shard.times("a") == [10.0, 20.0, 30.0, 40.0, 50.0]
        await scene.reader.stop()

    asyncio.run(scenario())


def test_a_zone_more_costs_no_connection(tmp_path: Path, brokers: list[Broker]) -> None:
    async def scenario() -> None:
        scene = await started(tmp_path, brokers)
        await scene.adopt(scene.plan.followed_by(scene.site("abcdefg")))
        assert len(brokers) == 1
        assert "g/T_i" in brokers[0].bound
        await scene.adopt(scene.plan.followed_by(scene.site("abcdefg", "tcp/127.0.0.1:8")))
        assert len(brokers) == 2
        await scene.reader.stop()

    asyncio.run(scenario())


def test_zones_that_move_by_the_reload_that_adds_one_take_what_is_not_durable_along(
    tmp_path: Path, brokers: list[Broker]
) -> None:
    async def scenario() -> None:
        scene = await started(tmp_path, brokers)
        await scene.adopt(scene.plan.followed_by(scene.site("abcdefg"), shard_names(2)))
        moving = scene.plan.moving
        assert moving
        scene.tell(40.0)
        await until(lambda: len(scene.shards["shard-0"].got) >= 4)
        await scene.adopt(scene.plan.settled())
        scene.tell(50.0)
        taker = scene.shards["shard-1"]
        await until(lambda: all(taker.times(zone)[-1:] == [50.0] for zone in moving))
        assert all(taker.times(zone) == [10.0, 20.0, 30.0, 40.0, 50.0] for zone in moving)
        await scene.reader.stop()

    asyncio.run(scenario())


def test_a_source_that_stays_off_is_built_anew_by_a_reload_of_its_channels(
    tmp_path: Path, brokers: list[Broker]
) -> None:
    async def scenario() -> None:
        scene = await started(tmp_path, brokers)
        brokers[0].given.put_nowait(None)
        line, _ = scene.reader._lines["bms"]
        await until(lambda: line._over)
        await scene.adopt(scene.plan.followed_by(scene.site("abcdefg")))
        scene.tell(40.0)
        await until(lambda: scene.shards["shard-0"].times("g") == [40.0])
        assert len(brokers) == 2
        await scene.reader.stop()

    asyncio.run(scenario())
