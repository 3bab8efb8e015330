"""What holds the event loop shows in the delay of its timers."""

import asyncio
import contextlib
import time
from typing import ClassVar

import pytest
from support.waiting import until

from service.daemon.loop_delay import IDLE_SECONDS, PROBE_SECONDS, watch_loop

HELD = 0.2


async def test_a_held_loop_is_seen():
    delays = []
    watching = asyncio.create_task(watch_loop(delays.append))
    await until(lambda: len(delays) >= 2)
    time.sleep(HELD)
    before = len(delays)
    await until(lambda: len(delays) > before + 1)
    watching.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await watching
    assert min(delays) >= 0.0
    assert max(delays) >= HELD - IDLE_SECONDS - PROBE_SECONDS


def test_an_idle_loop_is_asked_less_often(monkeypatch):
    class Loop:
        now = 0.0
        late = 0.0
        pauses: ClassVar[list[float]] = []

        def time(self):
            return self.now

        async def sleep(self, seconds):
            if len(self.pauses) == 8:
                raise asyncio.CancelledError
            self.pauses.append(seconds)
            self.now += seconds + (0.03 if len(self.pauses) == 5 else 0.0)

    loop, delays = Loop(), []
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: loop)
    monkeypatch.setattr(asyncio, "sleep", loop.sleep)
    with contextlib.suppress(asyncio.CancelledError):
        watch_loop(delays.append).send(None)
    assert loop.pauses == [0.01, 0.02, 0.04, 0.05, 0.05, 0.01, 0.02, 0.04]
    assert max(delays) == pytest.approx(0.03)
