"""REST clients of a daemon in a process of their own: each asks, waits for the answer, thinks, and asks again."""

from __future__ import annotations

import asyncio
import multiprocessing
import random
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, NamedTuple, Self

import httpx
import numpy as np

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
"""What is computed on request or grows with the number of zones; asked for by one client, rarely."""

_HEAVY_PAUSE = 1.0


class Answer(NamedTuple):
    """One request: endpoint, monotonic s when it was sent and answered, and the HTTP status (0: no answer)."""

    endpoint: str
    sent: float
    answered: float
    status: int


class Clients:
    """The running clients; a context manager. `finish` ends them and gives their answers."""

    def __init__(self, url: str, zones: list[str], count: int, pause: float) -> None:
        """`count` clients that think for `pause` s on average between an answer and the next question."""
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_run, args=(url, zones, count, pause, theirs), daemon=True)
        self._process.start()
        theirs.close()
        # What is measured begins when the process has imported what it needs, and everybody has had an answer.
        self._ours.recv()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.join()

    def finish(self) -> list[Answer]:
        """Let the clients come to their ends; everything they were answered."""
        self._ours.send("finish")
        answers: list[Answer] = self._ours.recv()
        self._process.join()
        return answers


def _run(url: str, zones: list[str], count: int, pause: float, pipe: Connection) -> None:
    pipe.send(asyncio.run(_ask(url, zones, count, pause, pipe)))


async def _ask(url: str, zones: list[str], count: int, pause: float, pipe: Connection) -> list[Answer]:
    answers: list[Answer] = []
    limits = httpx.Limits(max_connections=count + 1, max_keepalive_connections=count + 1)
    async with httpx.AsyncClient(base_url=url, timeout=60.0, limits=limits) as client:
        tasks = [
            asyncio.create_task(_client(client, ENDPOINTS, zones, pause, random.Random(number), answers))
            for number in range(count)
        ]
        heavy = _client(client, HEAVY_ENDPOINTS, zones, _HEAVY_PAUSE, random.Random(count), answers)
        tasks.append(asyncio.create_task(heavy))
        while len(answers) <= count and not any(task.done() for task in tasks):
            await asyncio.sleep(0.01)
        answers.clear()
        pipe.send("asking")
        # Rounds may be over before anybody has been answered; a measurement has an answer at least.
        while not (pipe.poll() and _promised(answers)) and not any(task.done() for task in tasks):
            await asyncio.sleep(0.05)
        for task in tasks:
            task.cancel()
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(result, Exception):
                raise result
    return answers


def _promised(answers: list[Answer]) -> bool:
    return any(answer.endpoint in ENDPOINTS for answer in answers)


async def _client(
    client: httpx.AsyncClient,
    endpoints: dict[str, str],
    zones: list[str],
    pause: float,
    choose: random.Random,
    answers: list[Answer],
) -> None:
    names = list(endpoints)
    turn = choose.randrange(len(names))
    while True:
        name = names[turn % len(names)]
        turn += 1
        sent = time.monotonic()
        try:
            status = (await client.get(endpoints[name].format(zone=choose.choice(zones)))).status_code
        except httpx.HTTPError:
            status = 0
        answers.append(Answer(name, sent, time.monotonic(), status))
        await asyncio.sleep(choose.expovariate(1.0 / pause))


def summary(answers: Sequence[Answer]) -> dict[str, Any]:
    """Count, refused requests and quantiles of the latency in s."""
    if not answers:
        return {"requests": 0, "not_ok": 0, "p50_s": None, "p99_s": None, "max_s": None}
    seconds = [answer.answered - answer.sent for answer in answers]
    return {
        "requests": len(answers),
        "not_ok": sum(answer.status != 200 for answer in answers),
        "p50_s": float(np.quantile(seconds, 0.5)),
        "p99_s": float(np.quantile(seconds, 0.99)),
        "max_s": float(max(seconds)),
    }
