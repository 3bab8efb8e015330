"""What a user waits for and pays: replay, start, answers, memory, and a fleet, on the commands as they are run."""

from __future__ import annotations

import asyncio
import gc
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import numpy as np

from replay.errors import MeasurementError
from replay.experiments.series.recorded_zone import samples_of
from replay.lab.measuring import fleet as load
from replay.lab.measuring.bench.section import Details, Section, Sizes, Target, text
from replay.lab.measuring.daemon import COMMAND, DaemonProcess, resident_bytes
from replay.lab.measuring.fleet import duration
from replay.lab.measuring.scenario import Scenario, write, zone_ids
from service.config import load as configuration
from service.config.fitting import make_alignment, make_worker

_PATIENCE = 300.0
(_ZONE,) = zone_ids(1)


def months(sizes: Sizes) -> Section:
    """Five months of samples through `thermogate replay`, CSV in and results out."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        folder = Path(name)
        scenario = Scenario(1, sizes.particles, "building-67", None, sizes.replay_samples)
        config, began = write(scenario, folder), time.perf_counter()
        with (folder / "log").open("w") as log:
            command = [*COMMAND, "replay", str(config), "--out", str(folder / "results")]
            process = subprocess.Popen(command, stdout=log, stderr=log)
            # `wait4` has the peak memory of this one child; `getrusage` only that of the largest so far.
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - began
        if process.returncode != 0:
            raise MeasurementError(f"thermogate replay failed: {(folder / 'log').read_text(encoding='utf-8').strip()}")
    found = f"{text(wall)} for {scenario.rows:,} samples, peak {usage.ru_maxrss * 1024 / 1e6:.0f} MB"
    return Section((Target("five months at 600 s, `thermogate replay`", "under 60 s", found, wall < 60.0),))


def memory(sizes: Sizes) -> Section:
    """Resident memory against the number of zones, each with a real worker: a fixed base and so much a zone."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        config = configuration.load(write(Scenario(1, sizes.particles, "building-67", None, 3), Path(name)))
        (table,) = config.zones
        samples = asyncio.run(samples_of(config, table))
    zones: list[Any] = []
    resident = []
    for count in sizes.resident_zones:
        while len(zones) < count:
            own = table.model_copy(update={"id": f"zone-{len(zones)}", "seed": len(zones)})
            worker = make_worker(own)
            for sample in samples[:3]:
                worker.step(sample)
            zones.append((worker, make_alignment(own)))
        gc.collect()
        resident.append(resident_bytes(os.getpid()))
    each, base = np.polyfit(sizes.resident_zones, resident, 1)
    found = f"{each / 1e6:.2f} MB beyond {base / 1e6:.0f} MB"
    return Section((Target("memory of a zone beyond a fixed base", "at most 2.6 MB", found, bool(each <= 2.6e6)),))


def start(sizes: Sizes) -> Section:
    """From the command to a serving daemon and its first forecast: cold, warm, and for other networks and counts."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        folder = Path(name)
        cache = folder / "kernels"
        cache.mkdir()
        cold, warm, network, count = (
            _start(folder / str(turn), cache, particles, preset)
            for turn, (particles, preset) in enumerate(
                (
                    (sizes.particles, "building-67"),
                    (sizes.particles, "building-67"),
                    (sizes.particles // 2, "titeth"),
                    (sizes.particles // 3, "titeth"),
                )
            )
        )
    return Section(
        (
            *(
                Target(f"start to serving a forecast, {how}", f"under {limit:g} s", _started(one), one[1] < limit)
                for how, limit, one in (("warm kernel cache", 2.0, warm), ("cold", 20.0, cold))
            ),
            Target(
                "one compilation serves every network and count",
                "nothing compiled anew",
                f"{network[2]} kernels for another network, {count[2]} for another count",
                network[2] + count[2] == 0,
            ),
        )
    )


def _started(one: tuple[float, float, int]) -> str:
    return f"{text(one[1])}; REST answers after {text(one[0])}"


def _start(folder: Path, cache: Path, particles: int, network: str) -> tuple[float, float, int]:
    """s to serving and to a forecast, and how many kernels were compiled."""
    config = write(Scenario(1, particles, network, None, 144), folder)
    compiled = _compiled(cache)
    with DaemonProcess(config, folder / "log", environment={"NUMBA_CACHE_DIR": str(cache)}) as daemon:
        url = daemon.url(_PATIENCE)
        httpx.get(f"{url}/healthz", timeout=60.0).raise_for_status()
        serving = time.monotonic() - daemon.began
        _until(daemon, lambda: httpx.get(f"{url}/zones/{_ZONE}/forecast", timeout=60.0).status_code == 200)
        forecast = time.monotonic() - daemon.began
        daemon.stop()
    return serving, forecast, _compiled(cache) - compiled


def _until(daemon: DaemonProcess, condition: Callable[[], bool]) -> None:
    while not condition():
        daemon.check()
        if time.monotonic() > daemon.began + _PATIENCE:
            raise MeasurementError(f"no answer {_PATIENCE:.0f} s after the start; its log: {daemon.log()}")
        time.sleep(0.01)


def _compiled(cache: Path) -> int:
    """How many compiled specialisations the cache holds."""
    return sum(1 for _ in cache.rglob("*.nbc"))


def fleet(sizes: Sizes) -> Section:
    """Zones in the real daemon whose samples land at the same instant."""
    zones, particles, every, count = sizes.fleet
    with TemporaryDirectory(prefix="thermogate-fleet-") as folder:
        found = load.run(Scenario(zones, particles, "building-67", every, count), Path(folder))
    rest, loop, last = found["rest"], found["event_loop"], found["last_forecast_s"]
    promised, late = rest["during_bursts"], loop["later_than_20_ms"]
    return Section(
        (
            Target(
                "resident memory of the daemon with all zones",
                "under 3 GB",
                f"{found['resident_bytes'] / 1e9:.2f} GB with {zones:,} zones",
                found["resident_bytes"] < 3e9,
            ),
            Target(
                "all samples at the same instant: last forecast",
                "within 3 s",
                f"{duration(last)}, the slowest of {count} instants",
                last is not None and last <= 3.0 and found["missing_forecasts"] == 0,
            ),
            Target(
                "REST meanwhile, 99th percentile",
                "under 25 ms",
                f"{duration(promised['p99_s'])} of {promised['requests']:,} requests",
                promised["p99_s"] is not None and promised["p99_s"] < 0.025,
            ),
            Target(
                "event loop held",
                "never longer than 20 ms",
                f"{late:.0f} of {loop['timers']:,.0f} timers later; none later than "
                f"{duration(loop['none_later_than_s'])}",
                late == 0,
            ),
        ),
        (
            Details(
                "A fleet on the real daemon",
                f"{zones:,} zones of building 67 with {particles:,} particles, whose samples land at the same instant "
                f"every {every:g} s; a Zenoh subscriber and {rest['clients']} REST clients run on the same machine. An "
                f"instant takes {found['cpu_seconds_per_round']:.1f} s of processor time.",
                ("instant", "median forecast", "last", "missing"),
                [
                    (number, duration(one["median_s"]), duration(one["last_s"]), one["missing"])
                    for number, one in enumerate(found["rounds"], start=1)
                ],
            ),
            Details(
                "REST while zones are being stepped",
                "The target is that of forecast, zone, history and health. The others are computed on request or list "
                "every zone, and one client asks for one of them a second.",
                ("endpoint", "requests", "not 200", "p50", "p99", "max"),
                [
                    (name, one["requests"], one["not_ok"], *(duration(one[key]) for key in ("p50_s", "p99_s", "max_s")))
                    for name, one in rest["endpoints_during_bursts"].items()
                ],
            ),
        ),
    )
