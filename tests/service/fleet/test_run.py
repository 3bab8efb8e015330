"""`thermogate fleet run` while there is no steward: one is created, and a stop waits for it."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from support.campus import small_site

from service.config.load import load

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.errors import Away
from service.fleet import peers
from service.fleet import run as module
from service.fleet.peers import STEWARD
from service.fleet.run import _Running


class Ray:
    """A steward that Ray has or has not, and what it was asked."""

    def __init__(self) -> None:
        self.there = False
        self.created = 0
        self.starts_that_fail = 0
        self.asked: list[str] = []

    def create(self, role: str, site: str, name: str) -> None:
        assert role == name == STEWARD
        if not self.there:
            self.created += 1
            self.there = self.created > self.starts_that_fail

    def remove(self, site: str, name: str) -> None:
        self.there = False


class Steward:
    """How `fleet run` asks it."""

    def __init__(self, ray: Ray) -> None:
        self._ray = ray

    async def ask(self, method: str, *arguments: Any, timeout: float | None = None) -> Any:
        await asyncio.sleep(0)
        if not self._ray.there:
            raise Away("the steward cannot be reached now")
        self._ray.asked.append(method)
        if method == "reload_wanted":
            await asyncio.sleep(0.01)
            return False
        return "done"


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> Ray:
    ray = Ray()
    monkeypatch.setattr(peers, "create", ray.create)
    monkeypatch.setattr(peers, "remove", ray.remove)
    monkeypatch.setattr(peers, "Peer", lambda site, name: Steward(ray))
    monkeypatch.setattr(module, "_AGAIN", 0.01)
    return ray


def _running(folder: Path) -> _Running:
    config = load(small_site(folder))
    return _Running(config, lambda: config)


async def _comes(ray: Ray, method: str) -> None:
    async with asyncio.timeout(5):
        while method not in ray.asked:
            await asyncio.sleep(0.01)


async def test_a_steward_that_could_not_be_started_is_created_again(tmp_path: Path, ray: Ray) -> None:
    ray.starts_that_fail = 2
    life = asyncio.create_task(_running(tmp_path).run())
    await _comes(ray, "reload_wanted")
    assert ray.created == 3
    # It was lost with its machine, and could not be started on another one.
    ray.there = False
    ray.asked.clear()
    await _comes(ray, "reload_wanted")
    assert ray.created == 4
    os.kill(os.getpid(), signal.SIGTERM)
    await asyncio.wait_for(life, 5)
    assert ray.asked[-1] == "stop"


async def test_a_stop_that_meets_a_lost_steward_stops_the_fleet_all_the_same(tmp_path: Path, ray: Ray) -> None:
    life = asyncio.create_task(_running(tmp_path).run())
    await _comes(ray, "reload_wanted")
    ray.there = False
    os.kill(os.getpid(), signal.SIGTERM)
    await asyncio.wait_for(life, 5)
    assert ray.asked[-1] == "stop"
    assert not ray.there
