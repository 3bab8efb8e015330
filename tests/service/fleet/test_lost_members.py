"""Every member that is wanted and that the cluster does not have is created, also one that the steward has known."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest
from support.campus import write_recording, write_site

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

    def create(self, role: str, site: str, name: str, cpus: float = 0.0, node: str | None = None) -> None:
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
        if method == "beat":
            return Beat(self.name, self._cluster.boots[self.name], NODE, 4321, 1, ready=True)
        return None


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Cluster:
    cluster = Cluster()
    monkeypatch.setattr(peers, "nodes", lambda: {NODE: "10.0.0.1"})
    monkeypatch.setattr(peers, "members", lambda site: set(cluster.members))
    monkeypatch.setattr(peers, "create", cluster.create)
    monkeypatch.setattr(peers, "remove", cluster.remove)
    monkeypatch.setattr("service.fleet.steward.Peer", lambda site, name: Asked(cluster, name))
    return cluster


def test_a_member_that_ray_does_not_start_any_more_is_created_again(tmp_path: Path, cluster: Cluster) -> None:
    write_recording(tmp_path / "recording.csv", 1, 3)
    path = write_site(tmp_path, "postgresql://db/x", site="campus", count=1, shards=2, pace=60.0, lease=5.0, cpus=1.0)
    every = {GATEWAY, "reader", "shard-0", "shard-1"}

    async def scenario() -> None:
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

    asyncio.run(scenario())
