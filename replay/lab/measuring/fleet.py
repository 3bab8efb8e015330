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
from typing import Any

import numpy as np
import zenoh

from replay.errors import MeasurementError
from replay.lab.measuring.clients import ENDPOINTS, Answer, Clients, summary
from replay.lab.measuring.daemon import COMMAND, DaemonProcess, delay_buckets, free_port, loop_delays, scrape
from replay.lab.measuring.scenario import SITE, Scenario, write, zone_ids

_POLL_SECONDS = 0.2


def run(scenario: Scenario, folder: Path, *, clients: int = 4, pause: float = 0.05) -> dict[str, Any]:
    """Measure `scenario` in `folder`, with so many REST clients that think for `pause` s.

    Raises MeasurementError where the daemon fails or falls behind for good.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / "state").exists():
        raise MeasurementError(f"{folder} holds the state of an earlier run; remove it or choose another folder")
    port, every = free_port(), scenario.every or 0.0
    config = write(scenario, folder, port)
    _compile(config, folder)
    heard: list[tuple[float, bytes]] = []
    with closing(_subscribed(port, heard)), DaemonProcess(config, folder / "daemon.log") as daemon:
        url = daemon.url()
        # The round that starts the filters; from then on every zone has a forecast to ask for.
        memory = _await(daemon, heard, scenario.zones, 3 * every)
        before, used = delay_buckets(scrape(url)), daemon.cpu_seconds()
        with Clients(url, zone_ids(scenario.zones), clients, pause) as asking:
            forecasts = scenario.zones * (1 + scenario.rounds)
            memory = max(memory, _await(daemon, heard, forecasts, (scenario.rounds + 1) * every))
            answers = asking.finish()
        used = daemon.cpu_seconds() - used
        after = delay_buckets(scrape(url))
        daemon.stop()
    found = rounds(arrivals(heard), scenario)
    return {
        "rounds": found,
        "last_forecast_s": max((one["last_s"] for one in found if one["last_s"]), default=None),
        "missing_forecasts": sum(one["missing"] for one in found),
        "rest": latencies(answers, found) | {"clients": clients},
        "event_loop": loop_delays(before, after),
        "resident_bytes": memory,
        "cpu_seconds_per_round": used / scenario.rounds,
    }


def _subscribed(port: int, heard: list[tuple[float, bytes]]) -> zenoh.Session:
    """A session that listens on `port` for the daemon and notes each forecast and when (monotonic s) it arrived."""
    config = zenoh.Config()
    settings = {"mode": "peer", "listen/endpoints": [f"tcp/127.0.0.1:{port}"], "scouting/multicast/enabled": False}
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise MeasurementError(f"Zenoh cannot listen on port {port} ({error}); stop what uses it") from error
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


def rounds(arrived: Mapping[float, Mapping[str, float]], scenario: Scenario) -> list[dict[str, Any]]:
    """Per measured round: when its first forecast came (monotonic s), and s from there to the median and the last."""
    found = []
    for when in sorted(arrived)[1 : 1 + scenario.rounds]:
        times = sorted(arrived[when].values())
        begun, after = times[0], np.array(times) - times[0]
        found.append(
            {
                "instant": begun,
                "missing": scenario.zones - len(times),
                "median_s": float(np.median(after)),
                "last_s": float(after[-1]),
            }
        )
    absent = {"instant": None, "missing": scenario.zones, "median_s": None, "last_s": None}
    return found + [absent] * (scenario.rounds - len(found))


def latencies(answers: Sequence[Answer], bursts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Latency of REST in s: while zones are being stepped: of the promised endpoints, and of each one."""
    spans = [(burst["instant"], burst["instant"] + burst["last_s"]) for burst in bursts if burst["last_s"]]

    def busy(answer: Answer) -> bool:
        return any(begin <= answer.answered and answer.sent <= end for begin, end in spans)

    promised, during = [one for one in answers if one.endpoint in ENDPOINTS], [one for one in answers if busy(one)]
    return {
        "during_bursts": summary([answer for answer in promised if busy(answer)]),
        "endpoints_during_bursts": {
            name: summary([answer for answer in during if answer.endpoint == name])
            for name in sorted({answer.endpoint for answer in during})
        },
    }


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
            raise MeasurementError(
                f"{count} of {forecasts} forecasts came and then none for {patience:.0f} s; "
                "give the rounds more time (--every)"
            )
        time.sleep(_POLL_SECONDS)
    return memory


def duration(value: float | None) -> str:
    """A time in s or ms, or that there is none."""
    return "none" if value is None else f"{value:.3g} s" if value >= 1.0 else f"{1000 * value:.3g} ms"
