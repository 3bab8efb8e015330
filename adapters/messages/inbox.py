"""The way from the threads of a client library into the event loop: bounded, and never in the library's way."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from contextlib import suppress
from typing import NamedTuple

LONGEST_PAYLOAD = 65_536
"""Bytes of a payload that are looked at; a longer one is no reading."""


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


class Share(NamedTuple):
    """What has come on one subscription since it was last taken, and how many older samples had to make room."""

    samples: list[Incoming]
    dropped: int


class Inbox:
    """One bounded queue per subscription, filled by any thread and emptied by the event loop that made it.

    A queue that is full drops its oldest sample: the newest say what is now. A flood on one key costs no other key.
    """

    def __init__(self, keys: list[str], room: int) -> None:
        """`room`: how many samples wait at most on each of `keys`."""
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._lock = threading.Lock()
        self._room = room
        self._queues: dict[str, deque[Incoming]] = {}
        self._dropped: dict[str, int] = {}
        self.listen_to(keys)
        self._told = False
        """Whether the loop knows already that there is something."""

    def listen_to(self, keys: list[str]) -> None:
        """These are the keys from now on; what waits on those that stay is kept."""
        with self._lock:
            self._queues = {key: self._queues.get(key) or deque(maxlen=self._room) for key in keys}
            self._dropped = {key: self._dropped.get(key, 0) for key in keys}

    def put(self, key: str, incoming: Incoming) -> None:
        """Take in a sample of the subscription to `key`; never waits. Any thread."""
        with self._lock:
            queue = self._queues.get(key)
            if queue is None:
                # The subscription has just been given up.
                return
            self._dropped[key] += len(queue) == queue.maxlen
            queue.append(incoming)
            if self._told:
                return
            self._told = True
        # Where the loop is gone, so is whoever would have taken the sample.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._news.set)

    async def take(self, timeout: float) -> dict[str, Share]:
        """Everything that has come, by key, as soon as there is anything; nothing after `timeout` s."""
        try:
            async with asyncio.timeout(timeout):
                await self._news.wait()
        except TimeoutError:
            return {}
        with self._lock:
            self._news.clear()
            self._told = False
            shares = {key: Share(list(queue), self._dropped[key]) for key, queue in self._queues.items() if queue}
            for key in shares:
                self._queues[key].clear()
                self._dropped[key] = 0
        return shares
