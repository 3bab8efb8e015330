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
"""Large answers that are made at a time, of one client one."""

LARGE_WAITING = 8
"""Of one client, with the one that is being made."""

TURN_RETRY_SECONDS = 1

LONG_WAIT_SECONDS = 5.0
"""A client that waits longer for its turn is told of in the log."""

REPEAT = 600.0
"""Who gets no turn is said again after this time at the earliest, in s."""

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


class Turns:
    """Work of which little is done at a time. Clients take turns, and one of which too much waits is refused, so that
    nobody waits for more than what is under way and one turn of each other client."""

    def __init__(self, work: str, at_once: int, of_one: int, waiting: int) -> None:
        """`work`: what it is, in the plural. `at_once` is done at a time, `of_one` client so much, of which `waiting`
        is under way or waits at most."""
        self._work, self._of_one, self._waiting = work, of_one, waiting
        self._room = asyncio.Semaphore(at_once)
        self._turns: dict[str, asyncio.Semaphore] = {}
        self._open: Counter[str] = Counter()
        self._say_at: dict[str, float] = {}

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """The time in which work for the client of this task is done. RequestRefused (429) if too much of it waits."""
        client = (current_asker() or Asker()).name
        if self._open[client] >= self._waiting:
            self._complain(
                "too many", f"{client} has {self._waiting} {self._work} waiting, and further ones are refused"
            )
            sentence = f"{self._waiting} of your {self._work} are waiting already; ask again when they are answered"
            raise RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], retry_after=TURN_RETRY_SECONDS)
        turn = self._turns.setdefault(client, asyncio.Semaphore(self._of_one))
        self._open[client] += 1
        asked = time.monotonic()
        try:
            async with turn, self._room:
                waited = time.monotonic() - asked
                if waited > LONG_WAIT_SECONDS:
                    told = ", ".join(f"{name} {count}" for name, count in self._open.most_common(3))
                    self._complain("late", f"{client} has waited {waited:.0f} s for its turn; {self._work}: {told}")
                yield
        finally:
            self._open[client] -= 1
            if not self._open[client]:
                del self._open[client], self._turns[client]

    def _complain(self, kind: str, sentence: str) -> None:
        """Log who gets no turn, now and then."""
        now = time.monotonic()
        if now >= self._say_at.get(kind, -math.inf):
            self._say_at[kind] = now + REPEAT
            _log.warning("%s", sentence)


class LargeAnswers(Turns):
    """Answers that take much memory."""

    def __init__(self) -> None:
        super().__init__("large answers", LARGE_AT_ONCE, 1, LARGE_WAITING)


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
