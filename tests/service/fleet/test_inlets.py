"""What the reader hands a shard reaches the zones that ask for it, also those that come later than others."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from support.waiting import until

from adapters.reading import Batch, Reading, Source
from service.errors import Away
from service.fleet.shards import inlets as module
from service.fleet.shards.inlets import Inlets

END = "end"


class Room:
    """A zone, as far as inlets ask it."""

    def __init__(self) -> None:
        self.had: list[float | str] = []

    @property
    def intake(self) -> Room:
        """Of the zone that this stands for."""
        return self

    def knows(self, reading: Reading) -> bool:
        return reading.time in self.had


class Scene:
    """Inlets, the rooms behind them, and feeds that deliver to these."""

    def __init__(self) -> None:
        self.rooms: dict[str, Room] = {}
        rooms: Any = self.rooms
        self.inlets = Inlets(rooms)
        self.feeds: list[asyncio.Task[None]] = []

    def add(self, *names: str) -> Source:
        """Rooms that are fed by one feed, which is about to begin."""
        self.rooms |= {name: Room() for name in names}
        config: Any = SimpleNamespace(sources={"log": SimpleNamespace(kind="csv")}, rooms=names)
        source = self.inlets.build(config, "log")
        self.feeds.append(asyncio.create_task(self._feed(source, names)))
        return source

    async def _feed(self, source: Source, names: tuple[str, ...]) -> None:
        async for batch in source.batches(None):
            for reading in batch.readings:
                self.rooms[reading.channel.split("/")[0]].had.append(reading.time)
        for name in names:
            self.rooms[name].had.append(END)
        await source.close()

    async def deliver(self, time: float, *names: str, again: bool = False) -> None:
        batch = Batch([Reading(f"{name}/T_i", time, 20.0) for name in names], time)
        await self.inlets.deliver("log", batch, again)

    async def stop(self) -> None:
        for feed in self.feeds:
            feed.cancel()
        await asyncio.gather(*self.feeds, return_exceptions=True)


@pytest.fixture(autouse=True)
def channels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_channels", lambda config, name: frozenset(f"{room}/T_i" for room in config.rooms))


async def ended() -> Scene:
    """A recording that has come to its end, which the attic has had."""
    scene = Scene()
    scene.add("attic")
    await asyncio.sleep(0)
    await scene.deliver(1.0, "attic")
    await scene.inlets.finish("log")
    await until(scene.feeds[0].done)
    return scene


def test_a_zone_that_comes_after_the_end_gets_what_it_is_owed_and_then_the_end() -> None:
    async def scenario() -> None:
        scene = await ended()
        scene.add("cellar")
        await asyncio.sleep(0)
        await scene.deliver(0.5, "cellar", again=True)
        await scene.deliver(1.0, "cellar", again=True)
        await scene.inlets.finish("log")
        await until(scene.feeds[1].done)
        assert scene.rooms["attic"].had == [1.0, END]
        assert scene.rooms["cellar"].had == [0.5, 1.0, END]

    asyncio.run(scenario())


def test_what_comes_again_after_the_end_is_taken_for_nothing() -> None:
    async def scenario() -> None:
        scene = await ended()
        # A reader in a new process reads the recording again, for a shard that is further behind.
        await scene.deliver(1.0, "attic", again=True)
        await scene.inlets.finish("log")
        assert scene.rooms["attic"].had == [1.0, END]

    asyncio.run(scenario())


def test_nothing_passes_before_every_feed_of_the_source_is_at_work() -> None:
    async def scenario() -> None:
        scene = Scene()
        with pytest.raises(Away):
            await scene.deliver(1.0, "attic")
        scene.add("attic")
        await asyncio.sleep(0)
        scene.add("cellar")
        with pytest.raises(Away):
            await scene.deliver(1.0, "attic", "cellar")
        await asyncio.sleep(0)
        await scene.deliver(1.0, "attic", "cellar")
        assert [room.had for room in scene.rooms.values()] == [[1.0], [1.0]]
        await scene.stop()

    asyncio.run(scenario())


def test_an_end_that_comes_before_a_feed_is_at_work_is_not_lost() -> None:
    async def scenario() -> None:
        scene = Scene()
        scene.add("attic")
        await scene.inlets.finish("log")
        await until(scene.feeds[0].done)
        assert scene.rooms["attic"].had == [END]

    asyncio.run(scenario())
