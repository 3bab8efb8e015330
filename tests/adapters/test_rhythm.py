"""Polls keep their rhythm, on a clock of its own by which a poll takes as long as is said."""

from types import SimpleNamespace

import pytest
from support.tables import tabled

import adapters.rhythm
from adapters.rhythm import Rhythm


@tabled
async def test_polls_keep_their_rhythm_and_late_ones_are_counted(took, began, late, caplog, monkeypatch):
    clock = SimpleNamespace(now=0.0)

    async def sleep(seconds):
        clock.now += seconds

    loop = SimpleNamespace(time=lambda: clock.now)
    monkeypatch.setattr(adapters.rhythm, "asyncio", SimpleNamespace(get_running_loop=lambda: loop, sleep=sleep))
    rhythm, times = Rhythm("sources.bms", 0.1), [0.0]
    rhythm.begin()
    for seconds in took:
        clock.now += seconds
        await rhythm.wait()
        times.append(clock.now)
    assert times == pytest.approx(began)
    assert rhythm.late == late
    assert caplog.text.count("sources.bms: a poll took") == late
