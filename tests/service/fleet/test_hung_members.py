"""A member that does not answer is ended, and nobody is who was not asked."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest
from support.campus import small_site

from service.config.load import load

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.errors import Away
from service.fleet import steward as module
from service.fleet.messages import Beat
from service.fleet.plan import Plan, shard_names
from service.fleet.steward import ANSWER_SECONDS, Known, Steward

NODE = "0123456789abcdef"
PID = 4321
LEASE = 5.0


class Clock:
    """The steward's."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


class Silent:
    """A member that is asked in vain, for as long as `seconds` say."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self.seconds = clock, ANSWER_SECONDS

    async def ask(self, method: str, *arguments: Any, timeout: float | None = None) -> Any:
        self._clock.now += self.seconds
        raise Away("shard-0 has not answered")


class Gateway:
    """What ends processes on the machine."""

    def __init__(self) -> None:
        self.ended: list[int] = []

    async def ask(self, method: str, pid: int, timeout: float | None = None) -> None:
        assert method == "end"
        self.ended.append(pid)


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Steward, Plan, Silent, Gateway, Clock]:
    """A steward that knew a shard, which answers no more."""
    config = load(small_site(tmp_path, lease=LEASE))
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    steward, shard, gateway = Steward("campus", "steward"), Silent(clock), Gateway()
    peers: dict[str, Any] = {"shard-0": shard, f"gateway-{NODE[:8]}": gateway}
    steward._peers, steward._nodes = peers, {NODE: "10.0.0.1"}
    steward._known["shard-0"] = Known(Beat("shard-0", "boot", NODE, PID, 1, ready=True), clock.now)
    return steward, Plan(1, config, shard_names(1)), shard, gateway, clock


async def _look(steward: Steward, plan: Plan, times: int) -> None:
    for _ in range(times):
        await steward._hear("shard-0")
        await steward._end_the_hung(plan)


def test_a_member_that_was_asked_in_vain_for_long_is_ended_once(
    scene: tuple[Steward, Plan, Silent, Gateway, Clock],
) -> None:
    steward, plan, _, gateway, _ = scene
    patience = round((3 * LEASE + ANSWER_SECONDS) / ANSWER_SECONDS)
    asyncio.run(_look(steward, plan, patience))
    assert gateway.ended == []
    asyncio.run(_look(steward, plan, 2))
    assert gateway.ended == [PID], "Ray needs time to start it anew"


def test_a_steward_that_stood_still_blames_nobody(scene: tuple[Steward, Plan, Silent, Gateway, Clock]) -> None:
    steward, plan, shard, gateway, clock = scene
    # Its machine was frozen, before and while it asked.
    clock.now += 3600.0
    asyncio.run(steward._end_the_hung(plan))
    shard.seconds = 3600.0
    asyncio.run(_look(steward, plan, 2))
    assert gateway.ended == []


def test_a_member_that_is_being_started_is_not_ended(scene: tuple[Steward, Plan, Silent, Gateway, Clock]) -> None:
    steward, plan, shard, gateway, _ = scene
    shard.seconds = 0.0
    asyncio.run(_look(steward, plan, 1000))
    assert gateway.ended == []
