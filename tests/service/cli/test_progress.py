"""How far a command is: nothing is shown where nobody watches, and what is awaited comes out as it is."""

from __future__ import annotations

import asyncio
import io
import sys

import pytest

from replay.experiments.progress import steps
from service.cli import progress
from service.cli.progress import waiting_for


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def watched(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """A terminal from now on; what a fixture sets, pytest takes back before the test begins."""
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr(progress, "_SLOW", 0.0)
    monkeypatch.setattr(progress, "_LOOK", 0.001)
    return shown


async def _slow(seconds: float) -> str:
    await asyncio.sleep(seconds)
    return "found"


async def _fails() -> str:
    raise OSError("no such device")


async def test_waiting_shows_the_time_that_is_left_and_gives_what_came(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watched(monkeypatch)
    with waiting_for("probe", 2, 60.0) as awaited:
        assert await awaited(_slow(0.3)) == "found"
        with pytest.raises(OSError, match="no such device"):
            await awaited(_fails())
    assert "probe" in terminal.getvalue()
    assert "left" in terminal.getvalue()


def test_what_is_awaited_ends_with_who_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    watched(monkeypatch)
    ended = []

    async def endless() -> None:
        try:
            await asyncio.sleep(3600)
        finally:
            ended.append(True)

    async def scenario() -> None:
        with waiting_for("probe", 1, 1.0) as awaited:
            waiting = asyncio.create_task(awaited(endless()))
            await asyncio.sleep(0.05)
            waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
            await asyncio.sleep(0)

    asyncio.run(scenario())
    assert ended == [True]


def test_nobody_watching_sees_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    async def scenario() -> str:
        with waiting_for("probe", 1, 0.1) as awaited:
            return await awaited(_slow(0.0))

    assert asyncio.run(scenario()) == "found"
    assert list(steps("abc", "reading", 3)) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""
