"""`thermogate fleet run`: every member that is wanted is there, one that hangs is ended, and none outlasts a stop."""

import asyncio
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from support.campus import small_site
from support.waiting import until

from service.config.load import load
from service.errors import Away, ReloadRefused

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.fleet import peers
from service.fleet import steward as module
from service.fleet.messages import Beat
from service.fleet.peers import ANSWER_SECONDS
from service.fleet.plan import Plan
from service.fleet.steward import Steward

NODE = "0123456789abcdef"
GATEWAY = f"gateway-{NODE[:8]}"
LEASE = 5.0


class Cluster:
    """What Ray has: members by name, how often each was created, and the plan; and the steward's clock."""

    def __init__(self) -> None:
        self.members: set[str] = set()
        self.created: list[str] = []
        self.ended: list[str] = []
        self.plan: Plan | None = None
        self.stopped: list[str] = []
        """Members that were asked to stop while a plan was kept."""
        self.silent: set[str] = set()
        self.patience = ANSWER_SECONDS
        """How long a silent member is waited for, s."""
        self.wanting: set[str] = set()
        """Gateways whose clients want a reload."""
        self.told: list[tuple[str, list[str]]] = []
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now

    def create(self, site: str, name: str, cpus: float = 0.0, node: str | None = None) -> None:
        self.members.add(name)
        self.created.append(name)

    def remove(self, site: str, name: str, for_good: bool = True) -> None:
        self.ended.append(name)
        if for_good:
            self.members.discard(name)


class Asked:
    """A member as the steward asks it."""

    def __init__(self, cluster: Cluster, name: str) -> None:
        self._cluster, self.name = cluster, name

    async def ask(self, method: str, *arguments: Any, timeout: float | None = None) -> Any:
        cluster = self._cluster
        if self.name in cluster.silent:
            cluster.now += cluster.patience
        if self.name in cluster.silent or self.name not in cluster.members:
            raise Away(f"{self.name} cannot be reached now")
        if method == "stop" and cluster.plan is not None:
            cluster.stopped.append(self.name)
        if method == "reloaded":
            cluster.told.append(arguments)
            cluster.wanting.discard(self.name)
        boot, wanted = str(cluster.created.count(self.name)), self.name in cluster.wanting
        return Beat(self.name, boot, NODE, 4321, 1, ready=True, reload_wanted=wanted)


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
    monkeypatch.setattr(module, "Peer", lambda site, name: Asked(cluster, name))
    monkeypatch.setattr(module, "time", cluster)
    monkeypatch.setattr(module, "LOOK", 0.01)
    return cluster


async def begun(folder: Path, shards: int = 2) -> Steward:
    """A steward whose fleet is to start."""
    config = load(small_site(folder, shards=shards, lease=LEASE))
    steward = Steward("campus", lambda: config)
    await steward.go_over(config)
    return steward


async def look(steward: Steward, times: int = 1) -> None:
    for _ in range(times):
        await steward.look()
        # What was asked is answered in between.
        await asyncio.gather(*steward._hearing.values())


async def test_a_member_that_ray_does_not_start_any_more_is_created_again(tmp_path: Path, cluster: Cluster) -> None:
    every = {GATEWAY, "shard-0", "shard-1"}
    steward = await begun(tmp_path)
    await look(steward, 3)
    assert sorted(cluster.created) == sorted(every), "none twice"
    for name in sorted(every):
        cluster.members.discard(name)
        await look(steward)
        assert name in cluster.members
        assert steward._beats[name].boot == "2"
    assert len(cluster.created) == 2 * len(every)


async def test_members_that_are_not_wanted_any_more_are_stopped(
    tmp_path: Path, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    steward = await begun(tmp_path, shards=3)
    await look(steward, 2)
    assert "on 2 shards" in await steward.go_over(load(small_site(tmp_path, shards=2, lease=LEASE)))
    monkeypatch.setattr(peers, "nodes", lambda: {"fedcba9876543210": "10.0.0.2"})
    await look(steward)
    assert cluster.members == {"gateway-fedcba98", "shard-0", "shard-1"}
    assert cluster.stopped == ["shard-2"], "the machine of the gateway is lost"


async def test_a_member_that_was_asked_in_vain_for_long_is_ended_and_then_has_twice_the_time(
    tmp_path: Path, cluster: Cluster
) -> None:
    steward = await begun(tmp_path)
    await look(steward, 2)
    asked = round((3 * LEASE + ANSWER_SECONDS) / ANSWER_SECONDS)
    for times, (well, patience) in enumerate([(0.0, asked), (0.0, 2 * asked), (module.FORGIVEN, asked + 1)]):
        cluster.now += well
        cluster.silent.add("shard-0")
        await look(steward, patience)
        assert len(cluster.ended) == times
        await look(steward, 3 * patience)
        assert cluster.ended == ["shard-0"] * (times + 1), "nobody is ended while it starts"
        assert "shard-0" in cluster.members
        cluster.silent.clear()
        await look(steward)


@pytest.mark.parametrize(("patience", "times"), [(3600.0, 2), (0.0, 200)])
async def test_nobody_is_blamed_for_a_steward_that_stood_still_or_a_start(
    tmp_path: Path, cluster: Cluster, patience: float, times: int
) -> None:
    steward = await begun(tmp_path)
    await look(steward, 2)
    cluster.silent, cluster.patience = {"shard-0"}, patience
    cluster.now += 3600.0
    await look(steward, times)
    assert cluster.ended == []


async def test_it_finds_the_fleet_reloads_and_stops_it_in_order(
    tmp_path: Path, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = small_site(tmp_path, shards=2)
    config = load(path)
    cluster.plan = Plan(7, config)
    life = asyncio.create_task(Steward("campus", lambda: load(path)).run(config))
    await until(lambda: len(cluster.members) == 3)
    assert cluster.plan.version == 7, "nothing has changed"
    text = path.read_text(encoding="utf-8")
    for changed, problem in (("\nnonsense = 1\n", "nonsense"), ("", ""), ('\n[site]\nid = "other"\n', "site.id")):
        path.write_text(
            text.replace('id = "campus"', 'id = "other"') if problem == "site.id" else text + changed, encoding="utf-8"
        )
        cluster.told.clear()
        cluster.wanting.add(GATEWAY)
        await until(lambda: cluster.told)
        done, problems = cluster.told[0]
        assert (problem in " ".join(problems), bool(done)) == (True, not problem)
    path.write_text(text.replace("shards = 2", "shards = 3"), encoding="utf-8")
    os.kill(os.getpid(), signal.SIGHUP)
    await until(lambda: "shard-2" in cluster.members)
    os.kill(os.getpid(), signal.SIGTERM)
    await asyncio.wait_for(life, 20)
    assert cluster.members == set()
    assert cluster.stopped[-1] == GATEWAY, "the shards have been stopped before"
    assert len(cluster.stopped) == 4
    assert cluster.plan is None


async def test_what_a_member_was_started_with_cannot_be_reloaded(tmp_path: Path, cluster: Cluster) -> None:
    steward = await begun(tmp_path)
    with pytest.raises(ReloadRefused, match="stop the fleet and start it again"):
        await steward.go_over(load(small_site(tmp_path, shards=2, lease=LEASE + 1)))


async def test_a_plan_that_is_not_kept_is_tried_again(tmp_path: Path, cluster: Cluster, monkeypatch: Any) -> None:
    config = load(small_site(tmp_path, shards=2, lease=LEASE))
    steward = Steward("campus", lambda: config)
    with monkeypatch.context() as failing:
        failing.setattr(peers, "remember", lambda site, plan: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            await steward.go_over(config)
    await steward.go_over(config)
    assert cluster.plan == Plan(1, config)
