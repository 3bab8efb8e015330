"""REST clients of a daemon in a process of their own: each asks, waits for the answer, thinks, and asks again."""

from __future__ import annotations

import asyncio
import multiprocessing
import random
import time
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
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
"""What is computed on request or grows with the number of zones; asked for by one client, once a second."""


class Answer(NamedTuple):
    """One request: endpoint, monotonic s when it was sent and answered, and the HTTP status (0: no answer)."""

    endpoint: str
    sent: float
    answered: float
    status: int


class Clients:
    """The running clients; a context manager. `finish` ends them and gives their answers."""

    def __init__(self, url: str, zones: Sequence[str], count: int, pause: float) -> None:
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

    def __exit__(self, *of: object) -> None:
        self._process.kill()
        self._process.join()

    def finish(self) -> list[Answer]:
        """Let the clients come to their ends; everything they were answered."""
        self._ours.send("finish")
        answers: list[Answer] = self._ours.recv()
        return answers


def _run(url: str, zones: Sequence[str], count: int, pause: float, pipe: Connection) -> None:
    pipe.send(asyncio.run(_ask(url, zones, count, pause, pipe)))


async def _ask(url: str, zones: Sequence[str], count: int, pause: float, pipe: Connection) -> list[Answer]:
    answers: list[Answer] = []

    async def ask(number: int, endpoints: Mapping[str, str], pause: float) -> None:
        choose, names = random.Random(number), list(endpoints)
        turn = choose.randrange(len(names))
        while True:
            name = names[turn := (turn + 1) % len(names)]
            sent = time.monotonic()
            try:
                status = (await client.get(endpoints[name].format(zone=choose.choice(zones)))).status_code
            except httpx.HTTPError:
                status = 0
            answers.append(Answer(name, sent, time.monotonic(), status))
            await asyncio.sleep(choose.expovariate(1.0 / pause))

    async with httpx.AsyncClient(base_url=url, timeout=60.0) as client:
        tasks = [asyncio.create_task(ask(number, ENDPOINTS, pause)) for number in range(count)]
        tasks.append(asyncio.create_task(ask(count, HEAVY_ENDPOINTS, 1.0)))
        while len(answers) <= count:
            await asyncio.sleep(0.01)
        answers.clear()
        pipe.send("asking")
        # Rounds may be over before anybody has been answered; a measurement has an answer at least.
        while not (pipe.poll() and promised(answers)):
            await asyncio.sleep(0.05)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    return answers


def promised(answers: Sequence[Answer]) -> list[Answer]:
    """Those for which a latency is promised."""
    return [answer for answer in answers if answer.endpoint in ENDPOINTS]


def summary(answers: Sequence[Answer]) -> dict[str, Any]:
    """Of the `promised` among `answers`: count, refused requests and quantiles of the latency in s."""
    kept = promised(answers)
    seconds = [answer.answered - answer.sent for answer in kept]
    p99, longest = (float(np.quantile(seconds, q)) if seconds else None for q in (0.99, 1.0))
    not_ok = sum(answer.status != 200 for answer in kept)
    return {"requests": len(kept), "not_ok": not_ok, "p99_s": p99, "max_s": longest}
