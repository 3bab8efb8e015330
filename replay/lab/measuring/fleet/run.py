"""One run of the fleet: the daemon started, listened to, asked and measured from outside."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx

from replay.errors import MeasurementError
from replay.lab.measuring.fleet import measures
from replay.lab.measuring.fleet.clients import Clients
from replay.lab.measuring.fleet.listener import Listener
from replay.lab.measuring.fleet.scenario import LONE_ROUNDS, Scenario, write, zone_ids
from replay.lab.measuring.processes import COMMAND, DaemonProcess

_POLL_SECONDS = 0.2


def run(
    scenario: Scenario,
    folder: Path,
    *,
    clients: int = 4,
    pause: float = 0.05,
    options: Mapping[str, object] | None = None,
) -> dict[str, Any]:
    """Measure `scenario` in `folder`, with so many REST clients that think for `pause` s; `options` are the zones'.

    Raises MeasurementError where the daemon fails or falls behind for good.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / "state").exists():
        raise MeasurementError(f"{folder} holds the state of an earlier run; remove it or choose another folder")
    port = _free_port()
    config = write(scenario, folder, port, options)
    _compile(config, folder)
    with Listener(port) as listener, DaemonProcess(config, folder / "daemon.log") as daemon:
        url = daemon.url()
        serving = time.monotonic() - daemon.began
        # The round that starts the filters; from then on every zone has a forecast to ask for.
        _await(daemon, listener, LONE_ROUNDS + scenario.zones, (LONE_ROUNDS + 2) * scenario.every)
        before, used = measures.delay_buckets(_metrics(url)), daemon.cpu_seconds()
        memory = daemon.memory()
        with Clients(url, zone_ids(scenario.zones), clients, pause) as asking:
            memory = max(
                memory,
                _await(
                    daemon,
                    listener,
                    LONE_ROUNDS + scenario.zones * (1 + scenario.rounds),
                    (scenario.rounds + 1) * scenario.every,
                ),
            )
            answers = asking.finish()
        used = daemon.cpu_seconds() - used
        after = measures.delay_buckets(_metrics(url))
        arrivals = listener.arrivals()
        stopping = daemon.stop()
    found = measures.rounds(arrivals, scenario)
    return {
        "scenario": scenario._asdict(),
        "serving_after_s": serving,
        "rounds": found,
        "last_forecast_s": max((round["last_s"] for round in found if round["last_s"]), default=None),
        "missing_forecasts": sum(round["missing"] for round in found),
        "rest": measures.latencies(answers, found) | {"clients": clients, "pause_s": pause},
        "event_loop": measures.loop_delays(before, after),
        "resident_bytes": memory,
        "cpu_seconds_per_round": used / scenario.rounds,
        "stop_s": stopping,
    }


def _compile(config: Path, folder: Path) -> None:
    """Replay one zone, so that the kernels are on disk and no instant falls into their compilation."""
    command = [*COMMAND, "replay", str(config), "--zone", zone_ids(1)[0], "--out", str(folder / "compiled")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise MeasurementError(f"the zones cannot be replayed: {done.stderr.strip()}")


def _await(daemon: DaemonProcess, listener: Listener, forecasts: int, patience: float) -> int:
    """Wait for so many forecasts, or until none has come for long; the largest resident memory meanwhile, bytes."""
    memory, heard, since = 0, -1, time.monotonic()
    while (count := listener.count) < forecasts:
        daemon.check()
        memory = max(memory, daemon.memory())
        if count != heard:
            heard, since = count, time.monotonic()
        elif time.monotonic() > since + max(patience, 60.0):
            raise MeasurementError(
                f"{count} of {forecasts} forecasts came and then none for {max(patience, 60.0):.0f} s; "
                "give the rounds more time (--every)"
            )
        time.sleep(_POLL_SECONDS)
    return memory


def _metrics(url: str) -> str:
    return httpx.get(f"{url}/metrics", timeout=60.0).raise_for_status().text


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
