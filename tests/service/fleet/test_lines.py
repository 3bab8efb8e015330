"""What the reader has read reaches the shards: whole, in order, and again where a shard is another process."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from math import inf
from pathlib import Path
from typing import Any

import pytest
from support.campus import PERIOD, START, rooms, write_recording, write_site
from support.waiting import until

from adapters.reading import Batch, Reading
from service.config.load import load
from service.config.site import Config
from service.errors import Away
from service.fleet.lines import ROOM, Line
from service.fleet.messages import Ack
from service.fleet.plan import Plan, shard_names

ROOMS = rooms(12)


class Told:
    """A source that delivers what it is given."""

    name = "log"

    def __init__(self) -> None:
        self.given: asyncio.Queue[Batch | None] = asyncio.Queue()
        self.began_at: float | None = -inf
        self.taken = 0

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        self.began_at = start
        while (batch := await self.given.get()) is not None:
            yield batch
            self.taken += 1

    async def close(self) -> None:
        pass

    def tell(self, step: int) -> None:
        """A row of the recording: every room at the beginning of an interval."""
        when = float(START + PERIOD * step)
        self.given.put_nowait(Batch([Reading(f"{room}/T_i", when, 20.0 + step) for room in ROOMS], when))


class Shard:
    """The other end: a process that takes batches, and may be another one the next time. What closed is durable."""

    def __init__(self, version: int = 1) -> None:
        self.boot, self.version, self.away = "first", version, False
        self.got: list[tuple[float, set[str]]] = []
        self.again: list[bool] = []
        self.durable: float | None = None
        self.ended = 0
        self.told: list[str] = []
        """What was delivered or told, in order."""

    async def ask(self, method: str, source: str, boot: str, *arguments: Any, timeout: float | None = None) -> Ack:
        await asyncio.sleep(0)
        if self.away:
            raise Away("it is being started")
        if boot == self.boot and method == "deliver":
            plan, batch, again = arguments
            if plan != self.version:
                raise Away("plans differ")
            self.told.append(method)
            self.got.append((batch.now, {reading.channel.split("/")[0] for reading in batch.readings}))
            self.again.append(again)
            self.durable = batch.now
        if boot == self.boot and method == "finish":
            if arguments != (self.version,):
                raise Away("plans differ")
            self.told.append(method)
            self.ended += 1
        return Ack(self.boot, self.version, self.durable)

    def start_anew(self, boot: str) -> None:
        self.boot, self.got, self.again = boot, [], []


@pytest.fixture
def config(tmp_path: Path) -> Config:
    write_recording(tmp_path / "recording.csv", len(ROOMS), 3)
    database = "postgresql://nobody@db.example/thermogate"
    return load(
        write_site(tmp_path, database, site="campus", count=len(ROOMS), shards=2, pace=60.0, lease=2.0, cpus=1.0)
    )


@pytest.fixture
def source(monkeypatch: pytest.MonkeyPatch) -> Told:
    told = Told()
    monkeypatch.setattr(Config, "build_source", lambda config, name: told)
    monkeypatch.setattr("service.fleet.lines.AGAIN", 0.01)
    monkeypatch.setattr("service.fleet.lines.LOOK", 0.02)
    return told


def owned(plan: Plan) -> dict[str, set[str]]:
    owner = plan.owners()
    return {shard: {room for room in ROOMS if owner[room] == shard} for shard in plan.shards}


async def run(plan: Plan, shards: dict[str, Shard]) -> tuple[Line, asyncio.Task[None]]:
    line = Line("log", plan, lambda name: shards[name])  # type: ignore[arg-type,return-value]  # as far as it is asked
    return line, asyncio.create_task(line.run())


async def stop(line: Line, task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await line.close()


def test_each_shard_gets_what_its_zones_ask_for_and_the_clock(config: Config, source: Told) -> None:
    async def scenario() -> None:
        plan, shards = Plan(1, config, shard_names(2)), {name: Shard() for name in shard_names(2)}
        line, task = await run(plan, shards)
        for step in range(4):
            source.tell(step)
        await until(lambda: all(len(shard.got) == 4 for shard in shards.values()))
        for name, shard in shards.items():
            assert shard.got == [(float(START + PERIOD * step), owned(plan)[name]) for step in range(4)]
            assert not any(shard.again)
        source.given.put_nowait(None)
        await until(lambda: all(shard.ended == 1 for shard in shards.values()))
        await stop(line, task)

    asyncio.run(scenario())


def test_a_recording_begins_where_the_zone_is_that_is_furthest_behind(config: Config, source: Told) -> None:
    async def scenario() -> None:
        shards = {name: Shard() for name in shard_names(2)}
        shards["shard-0"].durable, shards["shard-1"].durable = START + 1200.0, START + 600.0
        line, task = await run(Plan(1, config, shard_names(2)), shards)
        await until(lambda: source.began_at != -inf)
        assert source.began_at == START + 600.0
        await stop(line, task)

    asyncio.run(scenario())


def test_a_recording_that_begins_while_zones_move_waits_until_they_have_a_shard(config: Config, source: Told) -> None:
    async def scenario() -> None:
        plan = Plan(1, config, shard_names(1)).followed_by(shards=shard_names(2))
        assert plan.moving
        shards = {name: Shard(plan.version) for name in shard_names(2)}
        shards["shard-0"].durable, shards["shard-1"].durable = START + 1200.0, START + 600.0
        line, task = await run(plan, shards)
        await asyncio.sleep(0.1)
        assert source.began_at == -inf
        settled = plan.settled()
        line.assign(settled)
        for shard in shards.values():
            shard.version = settled.version
        await until(lambda: source.began_at != -inf)
        assert source.began_at == START + 600.0, "a zone that has moved is further behind"
        await stop(line, task)

    asyncio.run(scenario())


def test_a_recording_that_begins_while_a_zone_goes_to_quarantine_waits_for_it(config: Config, source: Told) -> None:
    async def scenario() -> None:
        shards = {name: Shard() for name in shard_names(2)}
        shards["shard-0"].durable, shards["shard-1"].durable = START + 1200.0, -inf
        line, task = await run(Plan(1, config, shard_names(2)), shards)
        await asyncio.sleep(0.1)
        assert source.began_at == -inf
        shards["shard-1"].durable = START + 600.0
        await until(lambda: source.began_at != -inf)
        assert source.began_at == START + 600.0
        await stop(line, task)

    asyncio.run(scenario())


def test_a_shard_in_a_new_process_gets_again_what_is_not_durable(config: Config, source: Told) -> None:
    async def scenario() -> None:
        plan, shards = Plan(1, config, shard_names(2)), {name: Shard() for name in shard_names(2)}
        line, task = await run(plan, shards)
        for step in range(4):
            source.tell(step)
        await until(lambda: all(len(shard.got) == 4 for shard in shards.values()))
        lost = shards["shard-1"]
        lost.away = True
        source.tell(4)
        await until(lambda: len(shards["shard-0"].got) == 5)
        # The row of the open interval was taken by the old process, and is gone with it.
        lost.start_anew("second")
        lost.durable, lost.away = START + PERIOD * 3.0, False
        await until(lambda: len(lost.got) >= 2)
        assert [now for now, _ in lost.got][-2:] == [START + PERIOD * 3.0, START + PERIOD * 4.0]
        assert all(zones == owned(plan)["shard-1"] for _, zones in lost.got)
        assert all(lost.again), "they may be there already"
        await stop(line, task)

    asyncio.run(scenario())


def test_a_zone_that_moves_takes_what_is_not_durable_along(config: Config, source: Told) -> None:
    async def scenario() -> None:
        plan = Plan(1, config, shard_names(1))
        shards = {name: Shard() for name in shard_names(2)}
        line, task = await run(plan, shards)
        for step in range(3):
            source.tell(step)
        await until(lambda: len(shards["shard-0"].got) == 3)
        moving = plan.followed_by(shards=shard_names(2))
        assert moving.moving
        line.assign(moving)
        source.tell(3)
        # The shards come to the plan later than the reader, and nothing passes before.
        await asyncio.sleep(0.05)
        assert len(shards["shard-0"].got) == 3
        shards["shard-0"].version = moving.version
        await until(lambda: len(shards["shard-0"].got) == 4)
        assert shards["shard-0"].got[-1][1] == set(ROOMS) - moving.moving
        settled = moving.settled()
        line.assign(settled)
        for shard in shards.values():
            shard.version = settled.version
        source.tell(4)
        taken = shards["shard-1"].got
        await until(lambda: taken and taken[-1][0] == START + PERIOD * 4.0)
        came = [now for now, zones in taken if zones == moving.moving]
        assert came[-3:] == [START + PERIOD * step for step in (2.0, 3.0, 4.0)]
        await stop(line, task)

    asyncio.run(scenario())


def test_zones_that_move_after_the_end_get_what_is_kept_and_then_the_end(config: Config, source: Told) -> None:
    async def scenario() -> None:
        # The shard that takes them has others of the recording, which have heard of its end.
        plan = Plan(1, config, shard_names(2))
        shards = {name: Shard() for name in shard_names(2)}
        line, task = await run(plan, shards)
        source.tell(0)
        source.given.put_nowait(None)
        await until(lambda: all(shard.ended == 1 for shard in shards.values()))
        fewer = plan.followed_by(shards=shard_names(1))
        for shard in shards.values():
            shard.version = fewer.version
        line.assign(fewer)
        await until(lambda: shards["shard-0"].ended == 2)
        settled = fewer.settled()
        shards["shard-0"].version, shards["shard-0"].told = settled.version, []
        line.assign(settled)
        await until(lambda: shards["shard-0"].ended == 3)
        assert shards["shard-0"].told == ["deliver", "finish"]
        assert shards["shard-0"].got[-1] == (float(START), fewer.moving)
        await asyncio.sleep(0.05)
        assert shards["shard-0"].ended == 3, "it is told once"
        await stop(line, task)

    asyncio.run(scenario())


def test_a_plan_that_comes_while_the_end_is_told_has_it_told_again(config: Config, source: Told) -> None:
    async def scenario() -> None:
        plan = Plan(1, config, shard_names(1))
        shard = Shard()
        line, task = await run(plan, {"shard-0": shard})
        followed = plan.followed_by(config)
        asked = shard.ask

        async def ask(method: str, *arguments: Any, timeout: float | None = None) -> Ack:
            ack = await asked(method, *arguments, timeout=timeout)
            if method == "finish" and shard.ended == 1:
                line.assign(followed)
                shard.version = followed.version
            return ack

        shard.ask = ask  # type: ignore[method-assign]
        source.given.put_nowait(None)
        await until(lambda: shard.ended == 2)
        await stop(line, task)

    asyncio.run(scenario())


def test_a_recording_waits_for_a_shard_that_is_away(config: Config, source: Told) -> None:
    async def scenario() -> None:
        shards = {name: Shard() for name in shard_names(2)}
        line, task = await run(Plan(1, config, shard_names(2)), shards)
        source.tell(0)
        await until(lambda: all(shard.got for shard in shards.values()))
        shards["shard-1"].away = True
        for step in range(1, 3 * ROOM):
            source.tell(step)
        await until(lambda: source.taken >= ROOM - 1)
        await asyncio.sleep(0.05)
        assert source.taken <= ROOM + 1
        shards["shard-1"].away = False
        await until(lambda: shards["shard-1"].got[-1][0] == START + PERIOD * (3.0 * ROOM - 1))
        await stop(line, task)

    asyncio.run(scenario())
