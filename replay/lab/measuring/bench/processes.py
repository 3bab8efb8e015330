"""What a user waits for and pays: replay, start, answers, memory, and a fleet, on the commands as they are run."""

from __future__ import annotations

import gc
import os
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import numpy as np

from replay.errors import MeasurementError
from replay.lab.measuring import fleet as load
from replay.lab.measuring.bench.rows import Row, Sizes, text
from replay.lab.measuring.daemon import COMMAND, DaemonProcess, resident_bytes
from replay.lab.measuring.scenario import Scenario, write, zone_ids
from replay.recorded.samples import read_samples
from service.config import load as configuration
from service.config.fitting import make_alignment, make_worker

_PATIENCE = 300.0
(_ZONE,) = zone_ids(1)


def months(sizes: Sizes) -> list[Row]:
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
    return [Row("five months at 600 s, `thermogate replay`", "under 60 s", found, wall < 60.0)]


def memory(sizes: Sizes) -> list[Row]:
    """Resident memory against the number of zones, each with a real worker: a fixed base and so much a zone."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        config = configuration.load(write(Scenario(1, sizes.particles, "building-67", None, 3), Path(name)))
        (table,) = config.zones
        samples = read_samples(config, [table])[table.id].samples
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
    return [Row("memory of a zone beyond a fixed base", "at most 2.6 MB", found, bool(each <= 2.6e6))]


def start(sizes: Sizes) -> list[Row]:
    """From the command to a serving daemon and its first forecast: cold, warm, and for other networks and counts."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        cache = Path(name) / "kernels"
        cache.mkdir()
        cold, warm, network, count = (
            _start(Path(name) / str(turn), cache, particles, preset)
            for turn, (particles, preset) in enumerate(
                [
                    *[(sizes.particles, "building-67")] * 2,
                    *[(sizes.particles // 2, "titeth"), (sizes.particles // 3, "titeth")],
                ]
            )
        )
    rows = [
        Row(
            f"start to serving a forecast, {how}",
            f"under {limit:g} s",
            f"{text(forecast)}; REST answers after {text(serving)}",
            forecast < limit,
        )
        for how, limit, (serving, forecast, _) in (("warm kernel cache", 2.0, warm), ("cold", 20.0, cold))
    ]
    found = f"{network[2]} kernels for another network, {count[2]} for another count"
    once = "one compilation serves every network and count"
    return [*rows, Row(once, "nothing compiled anew", found, network[2] + count[2] == 0)]


def _start(folder: Path, cache: Path, particles: int, network: str) -> tuple[float, float, int]:
    """s to serving and to a forecast, and how many kernels were compiled."""

    def kernels() -> int:
        return sum(1 for _ in cache.rglob("*.nbc"))

    config, compiled = write(Scenario(1, particles, network, None, 144), folder), kernels()
    with DaemonProcess(config, folder / "log", environment={"NUMBA_CACHE_DIR": str(cache)}) as daemon:
        url = daemon.url(_PATIENCE)
        httpx.get(f"{url}/healthz", timeout=60.0).raise_for_status()
        serving = time.monotonic() - daemon.began
        while httpx.get(f"{url}/zones/{_ZONE}/forecast", timeout=60.0).status_code != httpx.codes.OK:
            daemon.check()
            if time.monotonic() > daemon.began + _PATIENCE:
                raise MeasurementError(f"no forecast {_PATIENCE:.0f} s after the start")
            time.sleep(0.01)
        forecast = time.monotonic() - daemon.began
        daemon.stop()
    return serving, forecast, kernels() - compiled


def fleet(sizes: Sizes) -> list[Row]:
    """Zones in the real daemon whose samples land at the same instant."""
    zones, particles, every, count = sizes.fleet
    with TemporaryDirectory(prefix="thermogate-fleet-") as folder:
        found = load.run(Scenario(zones, particles, "building-67", every, count), Path(folder))
    resident, last, rest, loop = (found[key] for key in ("resident_bytes", "last_forecast_s", "rest", "event_loop"))
    return [
        Row(
            "resident memory of the daemon with all zones",
            "under 3 GB",
            f"{resident / 1e9:.2f} GB with {zones:,} zones",
            resident < 3e9,
        ),
        Row(
            "all samples at the same instant: last forecast",
            "within 3 s",
            f"{text(last)}, the slowest of {count} instants",
            last is not None and last <= 3.0 and found["missing_forecasts"] == 0,
        ),
        Row(
            "REST meanwhile, 99th percentile",
            "under 25 ms",
            f"{text(rest['p99_s'])} of {rest['requests']:,} requests",
            rest["p99_s"] is not None and rest["p99_s"] < 0.025,
        ),
        Row(
            "event loop held",
            "never longer than 20 ms",
            f"{loop['late']:.0f} of {loop['timers']:,.0f} timers later; none later than "
            f"{text(loop['none_later_than_s'])}",
            loop["late"] == 0,
        ),
    ]
