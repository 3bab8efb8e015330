"""Polls keep their rhythm, on a clock of its own by which a poll takes as long as is said."""

from types import SimpleNamespace

import pytest

import adapters.rhythm
from adapters.rhythm import Rhythm


@pytest.mark.parametrize(
    ("took", "began", "late"),
    [
        ([0.03, 0.09, 0.15, 0.0, 0.02], [0.0, 0.1, 0.2, 0.35, 0.45, 0.55], 0),
        ([0.35, 0.0], [0.0, 0.35, 0.45], 1),
    ],
    ids=["one that is late moves those after it", "what was missed is not made up for"],
)
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
