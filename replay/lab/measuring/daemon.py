"""Thermogate as processes of their own, and what they hold and do, seen from outside."""

from __future__ import annotations

import os
import re
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import httpx
import numpy as np

from replay.errors import MeasurementError

COMMAND = (sys.executable, "-m", "service")
"""The command `thermogate` of this very installation."""

_POLL_SECONDS = 0.005
_STOP_SECONDS = 60.0


class DaemonProcess:
    """`thermogate run`; a context manager that never leaves a process behind."""

    def __init__(
        self,
        config: Path,
        log: Path,
        *,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Starts it; `environment` is added to this process's own, `log` takes what it says."""
        self._log = log
        self.began = time.monotonic()
        with log.open("w", encoding="utf-8") as stream:
            self.process = subprocess.Popen(
                [*COMMAND, "run", str(config)],
                stdout=stream,
                stderr=stream,
                env={**os.environ, **(environment or {})},
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def url(self, timeout: float = 300.0) -> str:
        """The address it serves REST on, once it does; MeasurementError if it ends or takes longer than `timeout` s."""
        while time.monotonic() < self.began + timeout:
            found = re.search(r"serving on (http://\S+)", self.log())
            if found:
                return found[1]
            self.check()
            time.sleep(_POLL_SECONDS)
        raise MeasurementError(f"the daemon does not serve after {timeout:g} s; its log ends with: {self._last_line()}")

    def check(self) -> None:
        """MeasurementError if it has ended."""
        if self.process.poll() is not None:
            raise MeasurementError(
                f"the daemon has ended with exit code {self.process.returncode}; its log ends with: {self._last_line()}"
            )

    def log(self) -> str:
        """What it has said so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def memory(self) -> int:
        """Resident memory now, bytes."""
        return resident_bytes(self.process.pid)

    def cpu_seconds(self) -> float:
        """Processor time used so far, over all threads."""
        return _cpu_seconds(self.process.pid)

    def stop(self) -> float:
        """Stop it in order; how many s that took. MeasurementError where it does not end well."""
        began = time.monotonic()
        self.process.terminate()
        try:
            code = self.process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            raise MeasurementError(f"the daemon does not stop within {_STOP_SECONDS:g} s; see {self._log}") from None
        if code != 0:
            raise MeasurementError(f"the daemon stopped with exit code {code}; its log: {self._last_line()}")
        return time.monotonic() - began

    def _last_line(self) -> str:
        return (self.log().strip().splitlines() or ["(nothing)"])[-1]


def _cpu_seconds(process: int) -> float:
    stat = _stat(process)
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


def _stat(process: int) -> list[str]:
    """The figures of /proc/PID/stat after the name of the program."""
    return Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()


def resident_bytes(process: int) -> int:
    """Resident memory of a process now."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


class Observation(NamedTuple):
    """One look at the daemon. `elapsed` is real s since the beginning; counters count since the daemon's start."""

    elapsed: float
    resident_mb: float
    descriptors: int
    threads: int
    cpu_s: float
    disk_mb: float
    """Everything under `state_dir`."""
    samples: int
    """Accepted samples in the journal, all zones."""
    timers: float
    """Timers by which the event loop's delay is measured."""
    late_timers: float
    """Those that were more than 20 ms late."""
    overruns: float


def observe(daemon: DaemonProcess, state_dir: Path, url: str, elapsed: float) -> Observation:
    """Look at `daemon`, which serves on `url`."""
    process, metrics = Path(f"/proc/{daemon.process.pid}"), scrape(url)
    buckets = delay_buckets(metrics)
    timers = max(buckets.values(), default=0.0)
    with closing(sqlite3.connect(f"file:{state_dir / 'journal.sqlite3'}?mode=ro", uri=True, timeout=10.0)) as journal:
        (samples,) = journal.execute("SELECT count(*) FROM samples").fetchone()
    return Observation(
        elapsed=elapsed,
        resident_mb=daemon.memory() / 1e6,
        descriptors=sum(1 for _ in (process / "fd").iterdir()),
        threads=sum(1 for _ in (process / "task").iterdir()),
        cpu_s=daemon.cpu_seconds(),
        disk_mb=_disk(state_dir) / 1e6,
        samples=samples,
        timers=timers,
        late_timers=timers - buckets.get(0.02, 0.0),
        overruns=sum(map(float, re.findall(r"^thermogate_overruns_total(?:{.*})? (\S+)$", metrics, re.MULTILINE))),
    )


def _disk(folder: Path) -> int:
    size = 0
    for path in folder.rglob("*"):
        # A checkpoint may have been replaced meanwhile.
        with suppress(FileNotFoundError):
            size += path.stat().st_blocks * 512
    return size


def scrape(url: str) -> str:
    """The metrics of the daemon on `url`."""
    return httpx.get(f"{url}/metrics", timeout=60.0).raise_for_status().text


def delay_buckets(metrics: str) -> dict[float, float]:
    """Upper bound in s to count of the event-loop delays in a Prometheus exposition, cumulated."""
    pattern = r'^thermogate_event_loop_delay_seconds_bucket\{le="([^"]+)"\} (\S+)$'
    return {float(bound): float(count) for bound, count in re.findall(pattern, metrics, re.MULTILINE)}


def loop_delays(before: Mapping[float, float], after: Mapping[float, float]) -> dict[str, Any]:
    """Delays between two scrapes: how many timers, how many later than .02 s, and the bound that none exceeded."""
    counts = {bound: after[bound] - before.get(bound, 0.0) for bound in sorted(after)}
    total = counts[max(counts)]
    bound = min(bound for bound, count in counts.items() if count >= total)
    return {
        "timers": total,
        "later_than_20_ms": total - counts[0.02],
        "none_later_than_s": bound if np.isfinite(bound) else None,
    }


def free_port() -> int:
    """A port of this machine that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
