"""The measurements by name, each run in a process of its own: none is slower or larger for what another left behind."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from replay.lab.measuring.bench.sizes import SIZES, Sizes

_PATIENCE = 3600.0


def _sections() -> dict[str, Callable[[Sizes], Mapping[str, Any]]]:
    # Imported by the process that measures: the one that starts it needs none of it.
    from replay.lab.measuring.bench.sections.comparisons import comparisons
    from replay.lab.measuring.bench.sections.control import control
    from replay.lab.measuring.bench.sections.fleet import fleet
    from replay.lab.measuring.bench.sections.growth import growth
    from replay.lab.measuring.bench.sections.memory import memory
    from replay.lab.measuring.bench.sections.months import months
    from replay.lab.measuring.bench.sections.stages import stages
    from replay.lab.measuring.bench.sections.start import start
    from replay.lab.measuring.bench.sections.update import one_thread, two_threads

    return {
        "update": one_thread,
        "threads": two_threads,
        "stages": stages,
        "growth": growth,
        "months": months,
        "memory": memory,
        "start": start,
        "comparisons": comparisons,
        "control": control,
        "fleet": fleet,
    }


SECTIONS = (
    *("update", "threads", "stages", "growth", "months", "memory", "start"),
    *("comparisons", "control", "fleet"),
)


def measure(name: str, size: str, out: Path) -> None:
    """Measure section `name` in this process and write what it found to `out`."""
    out.write_text(json.dumps(_sections()[name](SIZES[size])), encoding="utf-8")


def measured(name: str, size: str) -> dict[str, Any]:
    """What section `name` found in a process of its own; `failed` with the reason where it did not come to its end."""
    with TemporaryDirectory(prefix="thermogate-section-") as folder:
        out = Path(folder) / "section.json"
        command = [
            sys.executable,
            "-m",
            "replay.lab.measuring.bench",
            "--section",
            name,
            "--size",
            size,
            "--out",
            str(out),
        ]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            return {"failed": f"not done after {_PATIENCE:.0f} s"}
        if done.returncode != 0:
            return {"failed": (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]}
        found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
        return found
