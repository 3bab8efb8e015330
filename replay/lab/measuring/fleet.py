"""Zones on the real daemon whose samples all land at once, measured from outside.

The daemon has no special access: a paced recording feeds every zone, a Zenoh subscriber hears every forecast, and REST
clients ask from a process of their own. An instant counts from its first forecast, which comes some ms after it.
"""

from __future__ import annotations

import json
import subprocess
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import zenoh

from replay.bms.zenoh_publisher import opened
from replay.errors import MeasurementError
from replay.lab.measuring.clients import Answer, Clients, summary
from replay.lab.measuring.daemon import COMMAND, DaemonProcess, free_port, loop_delays, scrape
from replay.lab.measuring.scenario import SITE, Scenario, write, zone_ids

_POLL_SECONDS = 0.2


def run(scenario: Scenario, folder: Path, *, clients: int = 4, pause: float = 0.05) -> dict[str, Any]:
    """Measure `scenario` in `folder`, with so many REST clients that think for `pause` s.

    Raises MeasurementError where the daemon fails or falls behind for good.
    """
    port, every = free_port(), scenario.every or 0.0
    config = write(scenario, folder, port)
    _compile(config, folder)
    heard: list[tuple[float, bytes]] = []
    with closing(_subscribed(port, heard)), DaemonProcess(config, folder / "daemon.log") as daemon:
        url = daemon.url()
        # The round that starts the filters; from then on every zone has a forecast to ask for.
        memory = _await(daemon, heard, scenario.zones, 3 * every)
        before = scrape(url)
        with Clients(url, zone_ids(scenario.zones), clients, pause) as asking:
            forecasts = scenario.zones * (1 + scenario.rounds)
            memory = max(memory, _await(daemon, heard, forecasts, (scenario.rounds + 1) * every))
            answers = asking.finish()
        delays = loop_delays(before, scrape(url))
        daemon.stop()
    found = rounds(arrivals(heard), scenario)
    return {
        "last_forecast_s": max((one.ended - one.began for one in found), default=None),
        "missing_forecasts": scenario.zones * (scenario.rounds - len(found)) + sum(one.missing for one in found),
        "rest": summary(during(answers, found)),
        "event_loop": delays,
        "resident_bytes": memory,
    }


def _subscribed(port: int, heard: list[tuple[float, bytes]]) -> zenoh.Session:
    """A session that listens on `port` for the daemon and notes each forecast and when (monotonic s) it arrived."""
    session = opened({"mode": "peer", "listen/endpoints": [f"tcp/127.0.0.1:{port}"]})
    # Read later: what takes time here would be taken from the daemon that is measured.
    session.declare_subscriber(
        f"thermogate/{SITE}/*/forecast", lambda sample: heard.append((time.monotonic(), sample.payload.to_bytes()))
    )
    return session


def arrivals(heard: Sequence[tuple[float, bytes]]) -> dict[float, dict[str, float]]:
    """Per sample time (UTC s): when the forecast of each zone arrived first."""
    found: dict[float, dict[str, float]] = defaultdict(dict)
    for arrived, payload in tuple(heard):
        forecast = json.loads(payload)
        found[datetime.fromisoformat(forecast["sample_time"]).timestamp()].setdefault(forecast["zone"], arrived)
    return dict(found)


class Round(NamedTuple):
    """When the first and the last forecast of an instant came (monotonic s), and how many did not."""

    began: float
    ended: float
    missing: int


def rounds(arrived: Mapping[float, Mapping[str, float]], scenario: Scenario) -> list[Round]:
    """Those that are measured, as far as anything came of them."""
    return [
        Round(min(times.values()), max(times.values()), scenario.zones - len(times))
        for _, times in sorted(arrived.items())[1 : 1 + scenario.rounds]
    ]


def during(answers: Sequence[Answer], bursts: Sequence[Round]) -> list[Answer]:
    """Those that were waited for while zones were being stepped."""
    return [
        answer for answer in answers if any(one.began <= answer.answered and answer.sent <= one.ended for one in bursts)
    ]


def _compile(config: Path, folder: Path) -> None:
    """Replay one zone, so that the kernels are on disk and no instant falls into their compilation."""
    command = [*COMMAND, "replay", str(config), "--zone", zone_ids(1)[0], "--out", str(folder / "compiled")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise MeasurementError(f"the zones cannot be replayed: {done.stderr.strip()}")


def _await(daemon: DaemonProcess, heard: Sequence[object], forecasts: int, patience: float) -> int:
    """Wait for so many forecasts, or until none has come for long; the largest resident memory meanwhile, bytes."""
    memory, seen, since, patience = 0, -1, time.monotonic(), max(patience, 60.0)
    while (count := len(heard)) < forecasts:
        daemon.check()
        memory = max(memory, daemon.memory())
        if count != seen:
            seen, since = count, time.monotonic()
        elif time.monotonic() > since + patience:
            raise MeasurementError(f"{count} of {forecasts} forecasts came and then none for {patience:.0f} s")
        time.sleep(_POLL_SECONDS)
    return memory
