"""From the command to a serving daemon, and to its first forecast: with compiled kernels on disk and without."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import tomli_w

from replay.errors import MeasurementError
from replay.lab.measuring.bench.sections.months import configuration
from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.processes import DaemonProcess
from replay.simulated import semi_synthetic

_PATIENCE = 300.0


def start(sizes: Sizes) -> Mapping[str, Any]:
    """A cold start, a warm one, and one of another network and number of particles on what the cold one compiled."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        folder = Path(name)
        recording = semi_synthetic.write_csv(semi_synthetic.generate(None, days=1, seed=1), folder / "day.csv")
        cache = folder / "kernels"
        cache.mkdir()
        cold = _start(folder / "cold", recording, cache, sizes.particles, "building-67")
        warm = _start(folder / "warm", recording, cache, sizes.particles, "building-67")
        other = _start(folder / "other", recording, cache, sizes.particles // 2, "titeth")
        again = _start(folder / "again", recording, cache, sizes.particles // 3, "titeth")
    return {"cold": cold, "warm": warm, "another_network_first": other, "another_network_then": again}


def _start(folder: Path, recording: Path, cache: Path, particles: int, network: str) -> dict[str, Any]:
    folder.mkdir()
    config = folder / "start.toml"
    config.write_text(tomli_w.dumps(configuration(recording, particles, network)), encoding="utf-8")
    compiled = _compiled(cache)
    with DaemonProcess(config, folder / "log", environment={"NUMBA_CACHE_DIR": str(cache)}) as daemon:
        url = daemon.url(_PATIENCE)
        httpx.get(f"{url}/healthz", timeout=60.0).raise_for_status()
        serving = time.monotonic() - daemon.began
        while httpx.get(f"{url}/zones/building/forecast", timeout=60.0).status_code != 200:
            daemon.check()
            if time.monotonic() > daemon.began + _PATIENCE:
                raise MeasurementError(f"no forecast {_PATIENCE:.0f} s after the start; its log: {daemon.log()}")
            time.sleep(0.01)
        forecast = time.monotonic() - daemon.began
        daemon.stop()
    return {
        "network": network,
        "particles": particles,
        "serving_s": serving,
        "first_forecast_s": forecast,
        "kernels_compiled": _compiled(cache) - compiled,
    }


def _compiled(cache: Path) -> int:
    """How many compiled specialisations the cache holds."""
    return sum(1 for _ in cache.rglob("*.nbc"))
