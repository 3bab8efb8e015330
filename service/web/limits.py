"""What one client may take of the daemon: streams, large answers, and wrong keys."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from http import HTTPStatus

from fastapi import Request

from service.records.asker import Asker, current_asker
from service.web.server.refusal import RequestRefused

STREAM_RETRY_SECONDS = 10

FAILURES = 10
"""Wrong keys that a peer may send at once, and then per FAILURE_SECONDS."""

FAILURE_SECONDS = 60.0

LARGE_AT_ONCE = 2
"""Large answers of a kind that are made at a time, of one client one."""

_PEERS = 1024
_log = logging.getLogger(__name__)


class StreamLimits:
    """How many streams are open, per client and in all."""

    def __init__(self, per_client: int, total: int) -> None:
        self._per_client = per_client
        self._total = total
        self._open: Counter[str] = Counter()

    @property
    def open(self) -> int:
        """Streams that are open now."""
        return self._open.total()

    @contextmanager
    def admitted(self, client: str) -> Iterator[None]:
        """Count a stream of `client` while it lasts; RequestRefused if there are too many."""
        if self._open[client] >= self._per_client:
            raise RequestRefused(
                HTTPStatus.TOO_MANY_REQUESTS,
                [f"you have {self._per_client} streams open, which is the limit for one client; close one"],
                retry_after=STREAM_RETRY_SECONDS,
            )
        if self.open >= self._total:
            raise RequestRefused(
                HTTPStatus.SERVICE_UNAVAILABLE,
                [f"{self._total} streams are open, which is the limit; try again later"],
                retry_after=STREAM_RETRY_SECONDS,
            )
        self._open[client] += 1
        try:
            yield
        finally:
            self._open[client] -= 1
            if not self._open[client]:
                del self._open[client]


async def stream_slot(request: Request) -> AsyncIterator[None]:
    """Dependency of a route that streams: a place among the streams until its answer has ended, however it ends.

    RequestRefused (429 or 503) before the answer begins if there is none. The client is the caller's key, without
    keys the address.
    """
    limits: StreamLimits = request.app.state.stream_limits
    with limits.admitted(request.scope["state"]["client"]):
        yield


class LargeAnswers:
    """Few answers that take much memory are made at a time; the clients take turns."""

    def __init__(self) -> None:
        self._room = asyncio.Semaphore(LARGE_AT_ONCE)
        self._turns: dict[str, asyncio.Semaphore] = {}
        self._open: Counter[str] = Counter()

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """The time in which an answer for the client of this task is made."""
        client = (current_asker() or Asker()).name
        turn = self._turns.setdefault(client, asyncio.Semaphore(1))
        self._open[client] += 1
        try:
            async with turn, self._room:
                yield
        finally:
            self._open[client] -= 1
            if not self._open[client]:
                del self._open[client], self._turns[client]


class FailedAttempts:
    """Wrong keys per peer: FAILURES at once, then as many per FAILURE_SECONDS, in a bounded table."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._peers: OrderedDict[str, tuple[float, float]] = OrderedDict()
        """Of each peer how many are left and when that was, longest unheard of first."""

    def count(self, peer: str) -> int:
        """Note a wrong key of `peer`; 0, or in how many s the next one is free."""
        now = self._clock()
        left, since = self._peers.pop(peer, (float(FAILURES), now))
        left = min(FAILURES, left + (now - since) * FAILURES / FAILURE_SECONDS)
        free = left >= 1.0
        if left == FAILURES:
            _log.warning("a request from %s with a wrong API key was refused", peer)
        elif free and left < 2.0:
            _log.warning("too many requests with wrong API keys from %s; refusing them for a while", peer)
        self._peers[peer] = (left - 1.0 if free else left, now)
        while len(self._peers) > _PEERS:
            self._peers.popitem(last=False)
        return 0 if free else max(1, math.ceil((1.0 - left) * FAILURE_SECONDS / FAILURES))
