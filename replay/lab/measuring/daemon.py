"""Thermogate as a process of its own, and what it holds and does, seen from outside."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

import httpx
from prometheus_client.parser import text_string_to_metric_families

from replay.errors import MeasurementError

COMMAND = (sys.executable, "-m", "service")
"""The command `thermogate` of this very installation."""

_POLL_SECONDS = 0.005
_STOP_SECONDS = 60.0
_DELAY = "thermogate_event_loop_delay_seconds_bucket"
_LATE = 0.02
"""s of delay from which on a timer of the event loop is late."""

Figures = Mapping[str, float]
"""Metrics by name, summed over their labels; buckets by name and upper bound."""


class DaemonProcess:
    """`thermogate run`; a context manager that never leaves a process behind."""

    def __init__(self, config: Path, log: Path, *, environment: Mapping[str, str] | None = None) -> None:
        """Starts it; `environment` is added to this process's own, `log` takes what it says."""
        self._log = log
        self.began = time.monotonic()
        with log.open("w", encoding="utf-8") as stream:
            command, given = [*COMMAND, "run", str(config)], {**os.environ, **(environment or {})}
            self.process = subprocess.Popen(command, stdout=stream, stderr=stream, env=given)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *of: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def url(self, timeout: float = 300.0) -> str:
        """The address it serves REST on, once it does; MeasurementError if it ends or takes longer than `timeout` s."""
        while time.monotonic() < self.began + timeout:
            found = re.search(r"serving on (http://\S+)", self._said())
            if found:
                return found[1]
            self.check()
            time.sleep(_POLL_SECONDS)
        raise self._failed(f"does not serve after {timeout:g} s")

    def check(self) -> None:
        """MeasurementError if it has ended."""
        if self.process.poll() is not None:
            raise self._failed(f"has ended with exit code {self.process.returncode}")

    def memory(self) -> int:
        """Resident memory now, bytes."""
        return resident_bytes(self.process.pid)

    def stop(self) -> float:
        """Stop it in order; how many s that took. MeasurementError where it does not end well."""
        began = time.monotonic()
        self.process.terminate()
        try:
            code = self.process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            raise self._failed(f"does not stop within {_STOP_SECONDS:g} s") from None
        if code != 0:
            raise self._failed(f"stopped with exit code {code}")
        return time.monotonic() - began

    def _said(self) -> str:
        return self._log.read_text(encoding="utf-8", errors="replace")

    def _failed(self, how: str) -> MeasurementError:
        last = (self._said().strip().splitlines() or ["(nothing)"])[-1]
        return MeasurementError(f"the daemon {how}; its log {self._log} ends with: {last}")


def resident_bytes(process: int) -> int:
    """Resident memory of a process now."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def scrape(url: str) -> Figures:
    """The metrics of the daemon on `url`."""
    found: dict[str, float] = defaultdict(float)
    text = httpx.get(f"{url}/metrics", timeout=60.0).raise_for_status().text
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            bound = sample.labels.get("le")
            found[sample.name if bound is None else f"{sample.name} {float(bound):g}"] += sample.value
    return found


def loop_delays(before: Figures, after: Figures) -> dict[str, Any]:
    """Delays of the event loop between two scrapes: how many timers, how many of them late, and the bound that none
    exceeded."""
    counts = {
        float(name.removeprefix(_DELAY)): count - before.get(name, 0.0)
        for name, count in after.items()
        if name.startswith(_DELAY)
    }
    total = max(counts.values(), default=0.0)
    bound = min((bound for bound, count in counts.items() if count >= total), default=float("inf"))
    late = total - counts.get(_LATE, 0.0)
    return {"timers": total, "late": late, "none_later_than_s": bound if bound < float("inf") else None}


class Observation(NamedTuple):
    """One look at the daemon. `elapsed` is real s since the beginning; counters count since the daemon's start."""

    elapsed: float
    resident_mb: float
    descriptors: float
    threads: int
    cpu_s: float
    disk_mb: float
    """Everything under `state_dir`."""
    samples: float
    """Of all zones."""
    timers: float
    """Timers by which the event loop's delay is measured."""
    late_timers: float
    overruns: float


def observe(daemon: DaemonProcess, state_dir: Path, url: str, elapsed: float) -> Observation:
    """Look at `daemon`, which serves on `url`."""
    found = scrape(url)
    delays = loop_delays({}, found)
    return Observation(
        elapsed=elapsed,
        resident_mb=found["process_resident_memory_bytes"] / 1e6,
        descriptors=found["process_open_fds"],
        threads=sum(1 for _ in Path(f"/proc/{daemon.process.pid}/task").iterdir()),
        cpu_s=found["process_cpu_seconds_total"],
        disk_mb=_disk(state_dir) / 1e6,
        samples=found["thermogate_samples_total"],
        timers=delays["timers"],
        late_timers=delays["late"],
        overruns=found["thermogate_overruns_total"],
    )


def _disk(folder: Path) -> int:
    size = 0
    for path in folder.rglob("*"):
        # A checkpoint may have been replaced meanwhile.
        with suppress(FileNotFoundError):
            size += path.stat().st_blocks * 512
    return size


def free_port() -> int:
    """A port of this machine that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
