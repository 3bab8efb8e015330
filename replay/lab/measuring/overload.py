"""`make overload`: ten times what the daemon was set up for, readings and samples; is anything lost?

Two runs on the real daemon. In one the devices of the simulated building are polled ten times as often as configured:
the readings are aggregated, and memory must stay level. In the other a recording brings samples more than ten times
faster than the estimator takes them: it has to wait, every sample must be used, in order, and REST must answer.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx

from replay.errors import MeasurementError, ReplayError
from replay.lab.measuring.clients import Clients, summary
from replay.lab.measuring.daemon import DaemonProcess
from replay.lab.measuring.scenario import Scenario, write, zone_ids
from replay.lab.measuring.soak import Soak, run

FACTOR = 10.0
MOST_GROWTH_MB = 10.0
"""What memory may grow by from the first third of a run to its end, in MB."""
_POLL = 0.2
"""s between two polls in the configuration of the simulated building at the pace of a soak."""
(_ZONE,) = zone_ids(1)


def readings(folder: Path, seconds: float, particles: int = 3000) -> dict[str, Any]:
    """Poll the simulated building FACTOR times as often as configured for `seconds`."""
    hours = seconds * Soak().pace / 3600.0
    soak = Soak(hours, particles=particles, every=max(0.5, seconds / 300.0), polls=_POLL / FACTOR, faults=False)
    found, observations = run(soak, folder)
    return {
        "samples": found["last"]["samples"],
        "expected_samples": int(seconds) * soak.zones,
        "overruns": found["last"]["overruns"],
        "requests_without_answer": found["company"]["not_answered"],
        "growth_mb": found["last"]["resident_mb"] - observations[len(observations) // 3].resident_mb,
        "cores": found["cores_used"],
    }


def samples(folder: Path, count: int, particles: int = 20_000, every: float = 0.001) -> dict[str, Any]:
    """Play `count` samples, one each `every` s, to one zone; what became of them.

    Raises MeasurementError where the daemon ends, or does not come to the end of the recording.
    """
    scenario = Scenario(1, particles, "building-67", every, count - 4)
    with DaemonProcess(write(scenario, folder), folder / "daemon.log") as daemon:
        url = daemon.url()
        memory: list[int] = []
        while not _status(url)["samples"]:
            daemon.check()
            time.sleep(0.1)
        with Clients(url, [_ZONE], 2, pause=0.05) as clients:
            began, status = time.monotonic(), _status(url)
            # While the clients came up, the first samples were taken.
            taken_before = int(status["samples"])
            while "come to an end" not in status["reason"]:
                daemon.check()
                memory.append(daemon.memory())
                if time.monotonic() > began + 60.0 + count:
                    raise MeasurementError(f"after {count + 60} s the recording is not over; its status is {status}")
                time.sleep(0.1)
                status = _status(url)
            took, answers = time.monotonic() - began, clients.finish()
        rows = httpx.get(f"{url}/zones/{_ZONE}/history", params={"limit": 20_000}, timeout=60.0).json()["rows"]
        stopped = daemon.stop()
    return {
        "factor": factor(scenario.rows - taken_before, took, every),
        "seconds": took,
        "samples": scenario.rows,
        "lost": scenario.rows - len({row["time"] for row in rows}),
        "out_of_order": sum(a["time"] >= b["time"] for a, b in pairwise(rows)),
        "overruns": status["overruns"],
        "rest": summary(answers),
        "growth_mb": (memory[-1] - memory[len(memory) // 3]) / 1e6,
        "stop_s": stopped,
    }


def factor(taken: int, seconds: float, every: float) -> float:
    """How many times more samples were offered, one each `every` s, than were `taken` within `seconds`."""
    return seconds / every / max(taken, 1)


def _status(url: str) -> dict[str, Any]:
    status: dict[str, Any] = httpx.get(f"{url}/zones/{_ZONE}", timeout=60.0).raise_for_status().json()["status"]
    return status


def lines(r: dict[str, Any], s: dict[str, Any]) -> list[str]:
    """What became of readings and of samples, for a terminal."""
    return [
        f"readings at {FACTOR:g} times the rate: {r['samples']:.0f} samples of about {r['expected_samples']}, "
        f"{r['overruns']:.0f} overruns, memory {r['growth_mb']:+.1f} MB, {r['cores']:.2f} cores",
        f"samples offered {s['factor']:.1f} times faster than they were taken, for {s['seconds']:.0f} s: "
        f"{s['samples']} samples, {s['lost']} lost, {s['out_of_order']} out of order, {s['overruns']} overruns; memory "
        f"{s['growth_mb']:+.1f} MB; REST {s['rest']['requests']} requests, {s['rest']['not_ok']} not ok, "
        f"p99 {1e3 * s['rest']['p99_s']:.0f} ms",
    ]


def held(r: dict[str, Any], s: dict[str, Any]) -> bool:
    """Whether nothing was lost and memory stayed level."""
    lost = r["requests_without_answer"] + s["lost"] + s["out_of_order"]
    level = max(r["growth_mb"], s["growth_mb"]) < MOST_GROWTH_MB
    return bool(level and not lost and r["samples"] >= 0.9 * r["expected_samples"])


def main() -> int:
    """Run both; 0 if nothing was lost and memory stayed level."""
    parser = argparse.ArgumentParser(prog="python -m replay.lab.measuring.overload", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of readings (default 600)")
    parser.add_argument("--samples", type=int, default=20_000, help="of the recording, 5 to 20,000 (default 20000)")
    parser.add_argument("--out", type=Path, default=Path("var/overload"), help="folder, emptied first")
    given = parser.parse_args()
    if given.seconds <= 0 or not 5 <= given.samples <= 20_000:
        parser.error("seconds are above 0, samples 5 to 20,000")
    shutil.rmtree(given.out, ignore_errors=True)
    try:
        offered = samples(given.out / "samples", given.samples)
        polled = readings(given.out / "readings", given.seconds)
    except ReplayError as error:
        print(f"overload: {error}", file=sys.stderr)
        return 1
    found = {"samples": offered, "readings": polled}
    (given.out / "overload.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print("\n".join(lines(polled, offered)))
    return 0 if held(polled, offered) else 1


if __name__ == "__main__":
    raise SystemExit(main())
