"""The way from the threads of a client library into the event loop: bounded, fair, and never in the library's way."""

import asyncio
import threading
from collections import OrderedDict, deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import NamedTuple

LONGEST_PAYLOAD = 65_536
"""Bytes of a payload that are looked at; a longer one is no reading."""

MOST_BYTES_OF_ONE = 2**20
"""Bytes of payloads that wait on one key."""

MOST_BYTES = 2**24
"""Bytes of payloads that wait on all keys together."""


class Incoming(NamedTuple):
    """A sample: its key or topic, payload (None: longer than LONGEST_PAYLOAD, or with `size` 0 deleted), Zenoh's time
    stamp if any, arrival (UTC s). `retained`: a broker had kept it, nobody knows for how long."""

    key: str
    payload: bytes | None
    size: int
    stamp: float | None
    arrived: float
    retained: bool = False

    @property
    def held(self) -> int:
        return 0 if self.payload is None else len(self.payload)


class Taken(NamedTuple):
    """The next sample, the subscription that it came on, and how many older ones of it had to make room."""

    key: str
    incoming: Incoming
    dropped: int


class _Queue:
    def __init__(self) -> None:
        self.samples: deque[Incoming] = deque()
        self.bytes = 0
        self.dropped = 0

    def pop(self) -> Incoming:
        incoming = self.samples.popleft()
        self.bytes -= incoming.held
        return incoming


class Inbox:
    """One bounded queue per subscription, filled by any thread and emptied by the event loop that made it. A full queue
    drops its oldest samples; queues take turns, so that a flood on one key neither costs nor delays another."""

    def __init__(self, keys: Iterable[str], room: int, most_bytes: int = MOST_BYTES_OF_ONE) -> None:
        """`room`: how many samples wait at most on each of `keys`; `most_bytes`: bytes of their payloads."""
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._lock = threading.Lock()
        self._room, self._most_bytes = room, most_bytes
        self._queues: dict[str, _Queue] = {}
        self._turns: OrderedDict[str, None] = OrderedDict()
        """The keys on which something waits, in the order of their turns."""
        self._bytes = 0
        self._told = False
        """Whether the loop knows already that there is something."""
        self.listen_to(keys)

    def listen_to(self, keys: Iterable[str]) -> None:
        """These are the keys from now on; what waits on those that stay is kept."""
        with self._lock:
            self._queues = {key: self._queues.get(key) or _Queue() for key in keys}
            self._bytes = sum(queue.bytes for queue in self._queues.values())
            self._turns = OrderedDict((key, None) for key in self._turns if key in self._queues)

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
            self._turns.setdefault(key)
            while len(queue.samples) > self._room or queue.bytes > self._most_bytes:
                self._drop(queue)
            while self._bytes > MOST_BYTES:
                self._drop(max(self._queues.values(), key=lambda one: one.bytes))
            if self._told:
                return
            self._told = True
        # Where the loop is gone, so is whoever would have taken the sample.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._news.set)

    async def wait(self, timeout: float) -> bool:
        """Wait until there is something, for `timeout` s at most; whether there is."""
        with self._lock:
            if self._turns:
                return True
            self._news.clear()
            self._told = False
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                await self._news.wait()
        with self._lock:
            return bool(self._turns)

    def take(self) -> Taken | None:
        """The next sample, None if there is none. Those of one subscription come in their order."""
        with self._lock:
            while self._turns:
                key, _ = self._turns.popitem(last=False)
                queue = self._queues[key]
                if not queue.samples:
                    # All have made room for those of other keys.
                    continue
                incoming = queue.pop()
                self._bytes -= incoming.held
                dropped, queue.dropped = queue.dropped, 0
                if queue.samples:
                    self._turns[key] = None
                return Taken(key, incoming, dropped)
        return None

    def put_back(self, key: str, incoming: Incoming) -> None:
        """Let a sample that was taken be the next one of its subscription again, when that has its turn."""
        with self._lock:
            if (queue := self._queues.get(key)) is not None:
                queue.samples.appendleft(incoming)
                queue.bytes += incoming.held
                self._bytes += incoming.held
                self._turns.setdefault(key)

    def waiting(self) -> Iterator[Taken]:
        """All that waits, and what comes meanwhile."""
        while (taken := self.take()) is not None:
            yield taken

    def _drop(self, queue: _Queue) -> None:
        self._bytes -= queue.pop().held
        queue.dropped += 1
