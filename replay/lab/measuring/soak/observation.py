"""What a running daemon holds, seen from outside: memory, descriptors, threads, disk, rows, loop delay, zones."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from replay.lab.measuring.fleet.measures import delay_buckets
from replay.lab.measuring.processes import DaemonProcess

_LATE = 0.02
_MEGABYTE = 1e6


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
    history: int
    """Rows of the history."""
    streams: int
    """Open streams of REST."""
    timers: float
    """Timers by which the event loop's delay is measured."""
    late_timers: float
    """Those that were more than 20 ms late."""
    overruns: float
    running: int
    """Zones in the state `running`."""


def observe(daemon: DaemonProcess, state_dir: Path, metrics: str, elapsed: float, streams: int) -> Observation:
    """Look at `daemon`, whose exposition of metrics is `metrics`."""
    process = Path(f"/proc/{daemon.process.pid}")
    buckets = delay_buckets(metrics)
    timers = max(buckets.values(), default=0.0)
    samples, history = _rows(state_dir / "journal.sqlite3")
    return Observation(
        elapsed=elapsed,
        resident_mb=daemon.memory() / _MEGABYTE,
        descriptors=sum(1 for _ in (process / "fd").iterdir()),
        threads=sum(1 for _ in (process / "task").iterdir()),
        cpu_s=daemon.cpu_seconds(),
        disk_mb=_disk(state_dir) / _MEGABYTE,
        samples=samples,
        history=history,
        streams=streams,
        timers=timers,
        late_timers=timers - buckets.get(_LATE, 0.0),
        overruns=_total(metrics, "thermogate_overruns_total"),
        running=int(_total(metrics, "thermogate_zone_state", 'state="running"')),
    )


def _total(metrics: str, name: str, label: str = "") -> float:
    """The sum of a metric over all label values that contain `label`."""
    found = re.findall(rf"^{name}(?:{{(.*)}})? (\S+)$", metrics, re.MULTILINE)
    return sum(float(value) for labels, value in found if label in labels)


def _disk(folder: Path) -> int:
    size = 0
    for path in folder.rglob("*"):
        try:
            size += path.stat().st_blocks * 512
        except FileNotFoundError:
            # A checkpoint may have been replaced meanwhile.
            continue
    return size


def _rows(journal: Path) -> tuple[int, int]:
    with closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True, timeout=10.0)) as connection:
        samples, history = (
            connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0] for table in ("samples", "history")
        )
    return samples, history
