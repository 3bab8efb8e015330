"""What holds the event loop shows in the delay of its timers."""

import asyncio
import contextlib
from typing import ClassVar

import pytest

from service.daemon.loop_delay import watch_loop


def test_a_held_loop_is_seen_and_an_idle_one_is_asked_less_often(monkeypatch):
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
