"""What one client may take of the daemon: one table of limits, one limiter, and a bound on wrong keys."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from http import HTTPStatus
from typing import NamedTuple

from fastapi import Request

from service.config.http import LimitsConfig
from service.pauses import Seldom
from service.records.asker import current_asker
from service.web.server.refusal import RequestRefused


class Limit(NamedTuple):
    """How much there may be of one kind of `work`, named in the plural: `at_once` of all clients and `of_one` of one
    of them are under way; of one, `waiting` are under way or wait, for at most `patience` s."""

    work: str
    at_once: int
    of_one: int
    waiting: int
    patience: float
    retry_after: int


STREAMS, POSTS, LARGE = "streams", "posts", "large"


def table(limits: LimitsConfig) -> dict[str, Limit]:
    """The limits that are in force: nobody waits for a stream; the journal writes one post after the other; and two
    large answers at a time are what memory has room for."""
    return {
        STREAMS: Limit("streams", limits.streams, limits.streams_per_client, 0, 0.0, 10),
        POSTS: Limit("posts of readings", 4, 2, 8, 60.0, 1),
        LARGE: Limit("large answers", 2, 1, 8, 10.0, 5),
    }


LONG_WAIT_SECONDS = 5.0
"""A client that waits longer for its turn is told of in the log."""

FAILURES = 10
"""Wrong keys that a peer may send at once, and then per FAILURE_SECONDS."""

FAILURE_SECONDS = 60.0

_PEERS = 1024
_log = logging.getLogger(__name__)


class Limiter:
    """Gives clients their turns, so that nobody waits for more than what is under way and one turn of each other
    client, and refuses what is too much."""

    def __init__(self, limits: LimitsConfig | None = None) -> None:
        self._queues = {kind: _Queue(limit) for kind, limit in table(limits or LimitsConfig()).items()}

    def open(self, kind: str) -> int:
        """How much of one kind is under way or waits."""
        return self._queues[kind].open.total()

    @asynccontextmanager
    async def turn(self, kind: str) -> AsyncIterator[None]:
        """The time in which work of one kind is done for the client of this task. RequestRefused: 429 if the client has
        too much of it or has waited too long, 503 if there is too much of it in all."""
        async with self._queues[kind].turn(current_asker().name):
            yield


class _Queue:
    """The clients of one kind of work."""

    def __init__(self, limit: Limit) -> None:
        self._limit = limit
        self._room = asyncio.Semaphore(limit.at_once)
        self._turns: dict[str, asyncio.Semaphore] = {}
        self._seldom = Seldom()
        self.open: Counter[str] = Counter()

    @asynccontextmanager
    async def turn(self, client: str) -> AsyncIterator[None]:
        """As of Limiter."""
        self._admit(client)
        turn = self._turns.setdefault(client, asyncio.Semaphore(self._limit.of_one))
        self.open[client] += 1
        try:
            await self._wait(client, turn)
            try:
                yield
            finally:
                self._room.release()
                turn.release()
        finally:
            self.open[client] -= 1
            if not self.open[client]:
                del self.open[client], self._turns[client]

    def _admit(self, client: str) -> None:
        limit, most = self._limit, max(self._limit.of_one, self._limit.waiting)
        if self.open[client] >= most:
            self._complain("too many", f"{client} has {most} {limit.work} open, and further ones are refused")
            sentence = f"you have {most} {limit.work} open, which is the limit for one client; wait, or close one"
            raise RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], limit.retry_after)
        if not limit.waiting and self.open.total() >= limit.at_once:
            sentence = f"{limit.at_once} {limit.work} are open, which is the limit; try again later"
            raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], limit.retry_after)

    async def _wait(self, client: str, turn: asyncio.Semaphore) -> None:
        """Until the client has its turn and there is room."""
        limit, asked = self._limit, time.monotonic()
        try:
            async with asyncio.timeout(limit.patience or None):
                await turn.acquire()
                try:
                    await self._room.acquire()
                except BaseException:
                    turn.release()
                    raise
        except TimeoutError:
            sentence = f"your {limit.work} have waited {limit.patience:g} s for their turn; ask for fewer at a time"
            raise RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], limit.retry_after) from None
        finally:
            waited = time.monotonic() - asked
            if waited > LONG_WAIT_SECONDS:
                told = ", ".join(f"{name} {count}" for name, count in self.open.most_common(3))
                self._complain("late", f"{client} has waited {waited:.0f} s for its turn; {limit.work}: {told}")

    def _complain(self, kind: str, sentence: str) -> None:
        """Log who gets no turn, now and then."""
        if self._seldom.due(kind):
            _log.warning("%s", sentence)


async def stream_slot(request: Request) -> AsyncIterator[None]:
    """Dependency of a route that streams: a place among the streams until its answer has ended, however it ends.

    RequestRefused (429 or 503) before the answer begins if there is none. The client is the caller's key, without
    keys the address.
    """
    limiter: Limiter = request.app.state.limiter
    async with limiter.turn(STREAMS):
        yield


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
