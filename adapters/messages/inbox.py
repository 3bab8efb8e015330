"""The way from the threads of a client library into the event loop: bounded, fair, and never in the library's way."""

from __future__ import annotations

import asyncio
import heapq
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

LONGEST_PAYLOAD = 65_536
"""Bytes of a payload that are looked at; a longer one is no reading."""

MOST_BYTES_OF_ONE = 2**20
"""Bytes of payloads that wait on one key."""

MOST_BYTES = 2**24
"""Bytes of payloads that wait on all keys together."""

_OVERHEAD = 512
"""The bytes that take about as long to read as everything about a message but its payload."""


class Incoming(NamedTuple):
    """A sample as it came: its key or topic, its payload, Zenoh's time stamp if it has one and when it came (UTC s).

    `payload` is None where `size` is more than LONGEST_PAYLOAD, or where the key was deleted (`size` 0). `retained`:
    a broker had kept it, and nobody knows for how long.
    """

    key: str
    payload: bytes | None
    size: int
    stamp: float | None
    arrived: float
    retained: bool = False

    @property
    def held(self) -> int:
        """Bytes of the payload that are in memory."""
        return 0 if self.payload is None else len(self.payload)


class Taken(NamedTuple):
    """The next sample, the subscription that it came on, and how many older ones of it had to make room."""

    key: str
    incoming: Incoming
    dropped: int


class _Queue:
    """What waits on one subscription."""

    def __init__(self) -> None:
        self.samples: deque[Incoming] = deque()
        self.bytes = 0
        self.dropped = 0
        self.due = 0
        """The place in the order of service that the next sample has at the earliest."""
        self.in_line = False

    def pop(self) -> Incoming:
        incoming = self.samples.popleft()
        self.bytes -= incoming.held
        return incoming


class Inbox:
    """One bounded queue per subscription, filled by any thread and emptied by the event loop that made it.

    A queue that is full drops its oldest samples: the newest say what is now. The queues are served by start-time fair
    queueing in bytes, so that a flood on one key neither costs nor delays what comes on another.
    """

    def __init__(self, keys: list[str], room: int, most_bytes: int = MOST_BYTES_OF_ONE) -> None:
        """`room`: how many samples wait at most on each of `keys`; `most_bytes`: bytes of their payloads."""
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._lock = threading.Lock()
        self._room, self._most_bytes = room, most_bytes
        self._queues: dict[str, _Queue] = {}
        self._line: list[tuple[int, str]] = []
        """Heap of the queues in which something waits, by their places."""
        self._served = 0
        """The place that was served last."""
        self._bytes = 0
        self._told = False
        """Whether the loop knows already that there is something."""
        self.listen_to(keys)

    def listen_to(self, keys: list[str]) -> None:
        """These are the keys from now on; what waits on those that stay is kept."""
        with self._lock:
            self._queues = {key: self._queues.get(key) or _Queue() for key in keys}
            self._bytes = sum(queue.bytes for queue in self._queues.values())

    def put(self, key: str, incoming: Incoming) -> None:
        """Take in a sample of the subscription to `key`; never waits. Any thread."""
        with self._lock:
            queue = self._queues.get(key)
            if queue is None:
                # The subscription has just been given up.
                return
            queue.samples.append(incoming)
            queue.bytes += incoming.held
            self._bytes += incoming.held
            while len(queue.samples) > self._room or queue.bytes > self._most_bytes:
                self._drop(queue)
            while self._bytes > MOST_BYTES:
                self._drop(max(self._queues.values(), key=lambda one: one.bytes))
            if not queue.in_line:
                queue.in_line = True
                heapq.heappush(self._line, (max(queue.due, self._served), key))
            if self._told:
                return
            self._told = True
        # Where the loop is gone, so is whoever would have taken the sample.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._news.set)

    async def wait(self, timeout: float) -> bool:
        """Wait until there is something, for `timeout` s at most; whether there is."""
        with self._lock:
            if self._line:
                return True
            self._news.clear()
            self._told = False
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                await self._news.wait()
        with self._lock:
            return bool(self._line)

    def take(self) -> Taken | None:
        """The next sample, None if there is none. Those of one subscription come in their order."""
        with self._lock:
            while self._line:
                place, key = heapq.heappop(self._line)
                queue = self._queues.get(key)
                if queue is None:
                    continue
                queue.in_line = False
                if not queue.samples:
                    continue
                incoming = queue.pop()
                self._bytes -= incoming.held
                dropped, queue.dropped = queue.dropped, 0
                self._served, queue.due = place, place + incoming.held + _OVERHEAD
                if queue.samples:
                    queue.in_line = True
                    heapq.heappush(self._line, (queue.due, key))
                return Taken(key, incoming, dropped)
        return None

    def waiting(self) -> Iterator[Taken]:
        """All that waits, and what comes meanwhile."""
        while (taken := self.take()) is not None:
            yield taken

    def _drop(self, queue: _Queue) -> None:
        self._bytes -= queue.pop().held
        queue.dropped += 1
