"""What holds the event loop shows in the delay of its timers."""

import asyncio
import contextlib
import time

from service.loop_delay import PROBE_SECONDS, watch_loop
from service.metrics import Metrics

HELD = 0.05


def test_a_held_loop_is_seen():
    delays = []

    async def scenario():
        watching = asyncio.create_task(watch_loop(delays.append))
        await asyncio.sleep(3 * PROBE_SECONDS)
        time.sleep(HELD)
        await asyncio.sleep(3 * PROBE_SECONDS)
        watching.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await watching

    asyncio.run(scenario())
    assert len(delays) >= 3
    assert min(delays) >= 0.0
    assert max(delays) >= HELD - 2 * PROBE_SECONDS


def test_delays_are_counted_by_bounds():
    metrics = Metrics({})
    metrics.observe_loop_delay(0.015)
    metrics.observe_loop_delay(0.3)
    name = "thermogate_event_loop_delay_seconds"
    assert metrics.registry.get_sample_value(f"{name}_bucket", {"le": "0.02"}) == 1
    assert metrics.registry.get_sample_value(f"{name}_count") == 2
