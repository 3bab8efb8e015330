"""Every member that is wanted and that the cluster does not have is created, also one that the steward has known; one
that does not answer is not called ready, and none outlasts a stop."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Any

import pytest
from support.campus import small_site

from service.config.load import load

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.errors import Away
from service.fleet import peers
from service.fleet.messages import Beat
from service.fleet.plan import Plan, shard_names
from service.fleet.steward import Steward

NODE = "0123456789abcdef"
GATEWAY = f"gateway-{NODE[:8]}"


class Cluster:
    """What Ray has: members by name, and how often each was created."""

    def __init__(self) -> None:
        self.members: set[str] = {"steward"}
        self.created: list[str] = []
        self.boots: dict[str, str] = {}
        self.slow = 0.0
        """How long a member takes to be created, s."""
        self.plan: Plan | None = None
        self.planless: list[str] = []
        """Members that were asked to stop when no plan was kept any more."""
        self.processors = 99
        """How many shards have room."""

    def create(self, role: str, site: str, name: str, cpus: float = 0.0, node: str | None = None) -> None:
        time.sleep(self.slow)
        self.members.add(name)
        self.created.append(name)
        self.boots[name] = f"{name} {len(self.created)}"

    def remove(self, site: str, name: str) -> None:
        self.members.discard(name)


class Asked:
    """A member as its peers have it."""

    def __init__(self, cluster: Cluster, name: str) -> None:
        self._cluster, self.name = cluster, name

    async def ask(self, method: str, *arguments: Any, timeout: float | None = None) -> Any:
        if self.name not in self._cluster.members:
            raise Away(f"{self.name} cannot be reached now")
        if self.name.startswith("shard-") and int(self.name.partition("-")[2]) >= self._cluster.processors:
            raise Away(f"{self.name} waits for a processor")
        if method == "beat":
            plan = self._cluster.plan
            version = 1 if plan is None else plan.version
            return Beat(self.name, self._cluster.boots[self.name], NODE, 4321, version, ready=True)
        if method == "stop" and self._cluster.plan is None:
            self._cluster.planless.append(self.name)
        return None


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Cluster:
    cluster = Cluster()
    monkeypatch.setattr(peers, "nodes", lambda: {NODE: "10.0.0.1"})
    monkeypatch.setattr(peers, "members", lambda site: set(cluster.members))
    monkeypatch.setattr(peers, "create", cluster.create)
    monkeypatch.setattr(peers, "remove", cluster.remove)
    monkeypatch.setattr(peers, "remembered", lambda site: cluster.plan)
    monkeypatch.setattr(peers, "remember", lambda site, plan: setattr(cluster, "plan", plan))
    monkeypatch.setattr(peers, "forget", lambda site: setattr(cluster, "plan", None))
    monkeypatch.setattr("service.fleet.steward.Peer", lambda site, name: Asked(cluster, name))
    return cluster


async def test_a_member_that_ray_does_not_start_any_more_is_created_again(tmp_path: Path, cluster: Cluster) -> None:
    path = small_site(tmp_path, shards=2)
    every = {GATEWAY, "shard-0", "shard-1"}
    steward = Steward("campus", "steward")
    steward._plan = Plan(1, load(path), shard_names(2))
    for _ in range(3):
        await steward._look()
        # What was asked is answered in between.
        await asyncio.gather(*steward._hearing.values())
    assert sorted(cluster.created) == sorted(every), "none twice"
    for name in sorted(every):
        cluster.members.discard(name)
        await steward._look()
        assert name in cluster.members
        await asyncio.gather(*steward._hearing.values())
        assert steward._known[name].beat.boot == cluster.boots[name]
    assert len(cluster.created) == 2 * len(every)


async def test_a_member_that_does_not_answer_is_not_ready(tmp_path: Path, cluster: Cluster) -> None:
    path = small_site(tmp_path, shards=2)

    async def ready(steward: Steward) -> dict[str, bool]:
        await asyncio.gather(*(steward._hear(name) for name in ("shard-0", "shard-1")))
        return {name: beat is not None and beat.ready for name, beat, _ in (await steward.status()).members}

    steward = Steward("campus", "steward")
    steward._plan = Plan(1, load(path), shard_names(2))
    await steward._look()
    await asyncio.gather(*steward._hearing.values())
    every = {GATEWAY: True, "shard-0": True, "shard-1": True}
    assert await ready(steward) == every
    cluster.members.discard("shard-1")
    assert await ready(steward) == every | {"shard-1": False}
    cluster.members.add("shard-1")
    assert await ready(steward) == every
    # Its machine is lost, and nobody has asked it since.
    steward._nodes = {}
    assert not any((await ready(steward)).values())


async def test_a_stop_leaves_no_member_that_is_being_created_meanwhile(tmp_path: Path, cluster: Cluster) -> None:
    path = small_site(tmp_path, shards=4)
    cluster.slow = 0.1
    steward = Steward("campus", "steward")
    await steward.wake()
    await steward.run(load(path))
    while "shard-0" not in cluster.members:
        await asyncio.sleep(0.01)
    await steward.stop()
    assert cluster.plan is None
    # What is on its way still is.
    await asyncio.sleep(10 * cluster.slow)
    assert cluster.members == {"steward"}


async def test_a_steward_that_is_lost_while_it_stops_leaves_the_plan_to_the_next(
    tmp_path: Path, cluster: Cluster
) -> None:
    path = small_site(tmp_path, shards=2)
    steward = Steward("campus", "steward")
    await steward.run(load(path))
    await steward._look()
    await steward.stop()
    assert cluster.members == {"steward"}
    assert cluster.planless == [], "the next steward would not know what to stop"
    assert cluster.plan is None


async def test_more_shards_than_the_machines_have_room_for_can_be_taken_back(tmp_path: Path, cluster: Cluster) -> None:
    path = small_site(tmp_path, count=12, shards=2)
    cluster.processors = 2

    async def look(steward: Steward) -> None:
        for _ in range(3):
            await steward._look()
            await asyncio.gather(*steward._hearing.values())

    steward = Steward("campus", "steward")
    await steward.run(load(path))
    await look(steward)
    await steward.rebalance(4)
    await look(steward)
    on_their_way = (await steward.status()).moving
    assert on_their_way > 0, "two shards cannot start"
    await steward.rebalance(2)
    assert (await steward.status()).moving >= on_their_way
    await look(steward)
    status = await steward.status()
    assert status.moving == 0
    assert {name for name, _, _ in status.members} == {GATEWAY, "shard-0", "shard-1"}
    assert cluster.members == {"steward", GATEWAY, "shard-0", "shard-1"}


def test_a_zone_on_its_way_stays_so_when_another_plan_follows(tmp_path: Path) -> None:
    path = small_site(tmp_path, count=12, shards=2)
    moving = Plan(1, load(path), shard_names(2)).followed_by(shards=shard_names(3))
    assert moving.moving
    # As at a reload that changes nothing of where they go.
    assert moving.followed_by().moving == moving.moving
    assert moving.followed_by().settled().moving == frozenset()
