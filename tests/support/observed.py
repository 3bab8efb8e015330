"""A daemon from outside: what it holds, how late its event loop is, and what REST clients wait for."""

import asyncio
import os
import random
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import numpy as np
from prometheus_client.parser import text_string_to_metric_families
from support.harness import Daemon
from support.processes import beside

ENDPOINTS = {
    "forecast": "/zones/{zone}/forecast",
    "zone": "/zones/{zone}",
    "history": "/zones/{zone}/history?limit=100",
    "health": "/healthz",
}
"""What the clients that a latency is promised to ask for, in turn."""

HEAVY_ENDPOINTS = {
    "parameters": "/zones/{zone}/parameters",
    "fan": "/zones/{zone}/forecast?horizon=6h",
    "zones": "/zones",
    "ready": "/readyz",
    "metrics": "/metrics",
}
"""What is computed on request or grows with the number of zones; one client asks for it, once a second."""

DELAY = "thermogate_event_loop_delay_seconds_bucket "
_LATE = 0.02
"""s of delay from which on a timer of the event loop is late."""


class Answer(NamedTuple):
    """One request: endpoint, monotonic s when it was sent and answered, and the HTTP status (0: no answer)."""

    endpoint: str
    sent: float
    answered: float
    status: int


@contextmanager
def clients(url: str, zones: Sequence[str], count: int, pause: float) -> Iterator[Callable[[], list[Answer]]]:
    """`count` clients in a process of their own, each of which asks, waits for the answer, and thinks for `pause` s on
    average. Gives what ends them and returns their answers, from when everybody had had one."""
    with beside(_ask_all, url, list(zones), count, pause) as pipe:
        pipe.recv()

        def finish() -> list[Answer]:
            pipe.send(None)
            return pipe.recv()

        yield finish


def _ask_all(url: str, zones: Sequence[str], count: int, pause: float, pipe: Connection) -> None:
    pipe.send(asyncio.run(_answers(url, zones, count, pause, pipe)))


async def _answers(url: str, zones: Sequence[str], count: int, pause: float, pipe: Connection) -> list[Answer]:
    answers: list[Answer] = []

    async def ask(number: int, endpoints: Mapping[str, str], pause: float) -> None:
        choose, names = random.Random(number), list(endpoints)
        turn = choose.randrange(len(names))
        while True:
            name = names[turn := (turn + 1) % len(names)]
            sent, status = time.monotonic(), 0
            with suppress(httpx.HTTPError):
                status = (await client.get(endpoints[name].format(zone=choose.choice(zones)))).status_code
            answers.append(Answer(name, sent, time.monotonic(), status))
            await asyncio.sleep(choose.expovariate(1.0 / pause))

    async with httpx.AsyncClient(base_url=url, timeout=60.0) as client:
        tasks = [asyncio.create_task(ask(number, ENDPOINTS, pause)) for number in range(count)]
        tasks.append(asyncio.create_task(ask(count, HEAVY_ENDPOINTS, 1.0)))
        while len(answers) <= count:
            await asyncio.sleep(0.01)
        answers.clear()
        pipe.send("asking")
        # What is measured may be over before anybody has been answered; it has an answer at least.
        while not (pipe.poll() and promised(answers)):
            await asyncio.sleep(0.05)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    return answers


def promised(answers: Sequence[Answer]) -> list[Answer]:
    """Those for which a latency is promised."""
    return [answer for answer in answers if answer.endpoint in ENDPOINTS]


def latency(answers: Sequence[Answer]) -> dict[str, Any]:
    """Of the `promised` among `answers`: how many, how many were not 200, and the .99 quantile of the latency in s."""
    kept = promised(answers)
    seconds = [answer.answered - answer.sent for answer in kept]
    p99 = float(np.quantile(seconds, 0.99)) if seconds else None
    return {"requests": len(kept), "not_ok": sum(answer.status != 200 for answer in kept), "p99_s": p99}


def resident_bytes(process: int) -> int:
    """Resident memory of a process now."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def scrape(daemon: Daemon) -> dict[str, float]:
    """The metrics of `daemon` by name, summed over their labels; buckets by name and upper bound."""
    found: dict[str, float] = defaultdict(float)
    for family in text_string_to_metric_families(daemon.text("/metrics")):
        for sample in family.samples:
            bound = sample.labels.get("le")
            found[sample.name if bound is None else f"{sample.name} {float(bound):g}"] += sample.value
    return found


def loop_delays(before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, Any]:
    """Delays of the event loop between two scrapes: how many timers, how many of them late, and the bound that none
    exceeded."""
    counts = {
        float(name.removeprefix(DELAY)): count - before.get(name, 0.0)
        for name, count in after.items()
        if name.startswith(DELAY)
    }
    total = max(counts.values(), default=0.0)
    bound = min((bound for bound, count in counts.items() if count >= total), default=float("inf"))
    return {"timers": total, "late": total - counts.get(_LATE, 0.0), "none_later_than_s": bound}


@dataclass(frozen=True)
class Observation:
    """One look at a daemon. `elapsed` is s since the beginning; counters count since the daemon's start."""

    elapsed: float
    resident_mb: float
    descriptors: float
    threads: int
    disk_mb: float
    """Everything in its state folder."""
    samples: float
    overruns: float


def observe(daemon: Daemon, state_dir: Path, elapsed: float) -> Observation:
    """Look at `daemon`."""
    found, size = scrape(daemon), 0
    for path in state_dir.rglob("*"):
        # A checkpoint may have been replaced meanwhile.
        with suppress(FileNotFoundError):
            size += path.stat().st_blocks * 512
    return Observation(
        elapsed=elapsed,
        resident_mb=found["process_resident_memory_bytes"] / 1e6,
        descriptors=found["process_open_fds"],
        threads=sum(1 for _ in Path(f"/proc/{daemon.process.pid}/task").iterdir()),
        disk_mb=size / 1e6,
        samples=found["thermogate_samples_total"],
        overruns=found["thermogate_overruns_total"],
    )
