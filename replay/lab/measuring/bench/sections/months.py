"""Five months of samples through `thermogate replay`, CSV in and results out, as a user runs it."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from replay.errors import MeasurementError
from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.processes import COMMAND
from replay.simulated import semi_synthetic


def months(sizes: Sizes) -> Mapping[str, Any]:
    """Wall time and peak memory of the process, and what it says of its scores."""
    with tempfile.TemporaryDirectory(prefix="thermogate-bench-") as name:
        folder = Path(name)
        recording = semi_synthetic.generate(None, days=sizes.replay_days, seed=1)
        semi_synthetic.write_csv(recording, folder / "months.csv")
        config = folder / "months.toml"
        config.write_text(tomli_w.dumps(configuration(folder / "months.csv", sizes.particles)), encoding="utf-8")
        began = time.perf_counter()
        with (folder / "log").open("w") as log:
            process = subprocess.Popen(
                [*COMMAND, "replay", str(config), "--out", str(folder / "results")], stdout=log, stderr=log
            )
            # `wait4` has the peak memory of this one child; `getrusage` only that of the largest so far.
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - began
        if process.returncode != 0:
            raise MeasurementError(f"thermogate replay failed: {(folder / 'log').read_text(encoding='utf-8').strip()}")
        summary = json.loads((folder / "results" / "summary.json").read_text(encoding="utf-8"))["zones"]["building"]
    return {
        "samples": summary["samples"],
        "particles": sizes.particles,
        "wall_s": wall,
        "processor_s": usage.ru_utime + usage.ru_stime,
        "peak_resident_bytes": usage.ru_maxrss * 1024,
        "coverage": summary["after_first_day"]["coverage"] if sizes.replay_days > 1 else summary["coverage"],
    }


def configuration(recording: Path, particles: int, network: str = "building-67") -> dict[str, object]:
    """A configuration of one zone fed by a file that `semi_synthetic.write_csv` wrote."""
    units = {"T_i": "degC", "T_out": "degC", "u_heat": "W", "I_sol": "W/m2"}
    used = list(units) if network == "building-67" else ["T_i", "T_out", "u_heat"]
    return {
        "site": {"id": "bench", "state_dir": "state"},
        "http": {"port": 0},
        "zenoh": {"enabled": False},
        "sources": {
            "recording": {"kind": "csv", "files": [str(recording)], "timestamp": {"column": "timestamp"}},
        },
        "zones": [
            {
                "id": "building",
                "period": "10min",
                "network": network,
                "estimator_options": {"particles": particles},
                "channels": {
                    channel: {"source": "recording", "column": channel, "unit": units[channel]} for channel in used
                },
            }
        ],
    }
