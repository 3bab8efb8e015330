"""What one client may take of the daemon: one table of limits, one limiter, and a bound on wrong keys."""

import asyncio
import math
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from http import HTTPStatus
from typing import NamedTuple

from fastapi import Request

from service.config.http import LimitsConfig
from service.records.asker import current_asker
from service.store.audit import AUDIT, about
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
POSTED_SECONDS = 60.0
"""A key may post as many bytes of readings at once as its rate allows in this time."""
_CLIENTS = 1024


class Limiter:
    """Gives clients their turns, so that nobody waits for more than what is under way and one turn of each other
    client, and refuses what is too much."""

    def __init__(self, limits: LimitsConfig | None = None) -> None:
        limits = limits or LimitsConfig()
        self._queues = {kind: _Queue(limit) for kind, limit in table(limits).items()}
        self._rate = limits.post_rate
        self._posted = Allowance(POSTED_SECONDS * limits.post_rate, POSTED_SECONDS)

    def open(self, kind: str) -> int:
        """How much of one kind is under way or waits."""
        return self._queues[kind].open.total()

    def turn(self, kind: str) -> AbstractAsyncContextManager[None]:
        """The time in which work of one kind is done for the client of this task. RequestRefused: 429 if the client has
        too much of it or has waited too long, 503 if there is too much of it in all."""
        return self._queues[kind].turn(current_asker().name)

    def admit_post(self) -> None:
        """RequestRefused (429) if the client of this task has posted too many bytes of readings lately."""
        client = current_asker().name
        if wait := self._posted.wait(client):
            sentence = f"you post more than {self._rate} bytes/s; wait, or raise http.limits.post_rate"
            AUDIT.warning("%s posts more than %d bytes/s", client, self._rate, extra=about("rate", client))
            raise RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], wait)

    def posted(self, count: int) -> None:
        """Note that the client of this task has posted `count` bytes of readings."""
        self._posted.take(current_asker().name, count)


class _Queue:
    """The clients of one kind of work."""

    def __init__(self, limit: Limit) -> None:
        self._limit = limit
        self._room = asyncio.Semaphore(limit.at_once)
        self._turns: dict[str, asyncio.Semaphore] = {}
        self.open: Counter[str] = Counter()

    @asynccontextmanager
    async def turn(self, client: str) -> AsyncIterator[None]:
        self._admit(client)
        turn = self._turns.setdefault(client, asyncio.Semaphore(self._limit.of_one))
        self.open[client] += 1
        try:
            async with AsyncExitStack() as taken:
                await self._take(client, turn, taken)
                yield
        finally:
            self.open[client] -= 1
            if not self.open[client]:
                del self.open[client], self._turns[client]

    def _admit(self, client: str) -> None:
        limit, most = self._limit, max(self._limit.of_one, self._limit.waiting)
        if self.open[client] >= most:
            sentence = "%s has %d %s open, and further ones are refused"
            AUDIT.warning(sentence, client, most, limit.work, extra=about("too-many", client))
            sentence = f"you have {most} {limit.work} open, which is the limit for one client; wait, or close one"
            raise RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], limit.retry_after)
        if not limit.waiting and self.open.total() >= limit.at_once:
            sentence = f"{limit.at_once} {limit.work} are open, which is the limit; try again later"
            raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], limit.retry_after)

    async def _take(self, client: str, turn: asyncio.Semaphore, taken: AsyncExitStack) -> None:
        """Wait until the client has its turn and there is room; `taken` gives both back."""
        limit, asked = self._limit, time.monotonic()
        try:
            async with asyncio.timeout(limit.patience or None):
                await taken.enter_async_context(turn)
                await taken.enter_async_context(self._room)
        except TimeoutError:
            sentence = f"your {limit.work} have waited {limit.patience:g} s for their turn; ask for fewer at a time"
            raise RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], limit.retry_after) from None
        finally:
            waited = time.monotonic() - asked
            if waited > LONG_WAIT_SECONDS:
                told = ", ".join(f"{name} {count}" for name, count in self.open.most_common(3))
                sentence = "%s has waited %.0f s for its turn; %s: %s"
                AUDIT.warning(sentence, client, waited, limit.work, told, extra=about("starved", client))


async def stream_slot(request: Request) -> AsyncIterator[None]:
    """Dependency of a route that streams: a place among the streams of the client, which is the caller's key or
    address, until its answer has ended. RequestRefused (429 or 503) before the answer begins if there is none."""
    async with request.app.state.limiter.turn(STREAMS):
        yield


class Allowance:
    """What clients may take over time: `most` at once, and as much again in `seconds`; in a bounded table."""

    def __init__(self, most: float, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._most, self._rate, self._clock = most, most / seconds, clock
        self._clients: OrderedDict[str, tuple[float, float]] = OrderedDict()
        """Of each client what was left and when that was, longest unheard of first."""

    def left(self, client: str) -> float:
        """What `client` may take now; less than nothing where it has taken more than it might."""
        left, since = self._clients.get(client, (self._most, 0.0))
        return min(self._most, left + (self._clock() - since) * self._rate)

    def wait(self, client: str) -> int:
        """0, or in how many s one more is free for `client`."""
        missing = 1.0 - self.left(client)
        return max(1, math.ceil(missing / self._rate)) if missing > 0.0 else 0

    def take(self, client: str, amount: float) -> None:
        """Note that `client` takes `amount`, be it more than is left."""
        self._clients[client] = self.left(client) - amount, self._clock()
        self._clients.move_to_end(client)
        while len(self._clients) > _CLIENTS:
            self._clients.popitem(last=False)


class FailedAttempts:
    """Wrong keys per peer: FAILURES at once, then as many per FAILURE_SECONDS."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._allowed = Allowance(FAILURES, FAILURE_SECONDS, clock)

    def count(self, peer: str) -> int:
        """Note a wrong key of `peer`; 0, or in how many s the next one is free."""
        left, wait = self._allowed.left(peer), self._allowed.wait(peer)
        if left == FAILURES:
            AUDIT.warning("a request from %s with a wrong API key was refused", peer, extra=about("wrong-key", peer))
        elif 1.0 <= left < 2.0:
            sentence = "too many requests with wrong API keys from %s; refusing them for a while"
            AUDIT.warning(sentence, peer, extra=about("wrong-keys", peer))
        if not wait:
            self._allowed.take(peer, 1.0)
        return wait
