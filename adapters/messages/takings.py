"""What a source takes out of its inbox: readings, and a word about what had to be dropped."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterator, Sequence

from adapters.messages.inbox import Inbox
from adapters.messages.points import REPEAT, MessageChannels
from adapters.reading import Fault, Reading

SLICE_SECONDS = 0.004
"""How long the event loop is held before others have their turn; one sample at least is read in a turn."""

TOGETHER_SECONDS = 0.1
"""For how long readings are collected under a flood before they are delivered: every delivery concerns all zones."""

MOST_TOGETHER = 500
"""Readings that are delivered in a turn of the event loop, and from which on no more are collected."""

_log = logging.getLogger(__name__)


def pieces(readings: Sequence[Reading]) -> Iterator[list[Reading]]:
    """`readings` in pieces of MOST_TOGETHER at most, one at least: a single message may hold thousands."""
    for first in range(0, max(len(readings), 1), MOST_TOGETHER):
        yield list(readings[first : first + MOST_TOGETHER])


class Takings:
    """Makes readings of what has come for the `channels` of the source `name`."""

    def __init__(self, name: str, channels: MessageChannels) -> None:
        self.dropped = 0
        """How many samples were dropped because they came faster than they could be taken."""
        self._name, self._channels = name, channels
        self._drop_said = float("-inf")

    async def readings(self, inbox: Inbox) -> list[Reading]:
        """The readings of what waits in `inbox`, as far as they go together, with a bad one for every occasion on which
        samples were dropped."""
        readings: list[Reading] = []
        turn = begun = time.monotonic()
        for key, incoming, dropped in inbox.waiting():
            if dropped:
                self._note_drop(key, dropped)
                readings += self._channels.bad(key, Fault.OVERRUN)
            readings += self._channels.came(key, [incoming])
            now = time.monotonic()
            if len(readings) >= MOST_TOGETHER or now - begun >= TOGETHER_SECONDS:
                break
            if now - turn >= SLICE_SECONDS:
                await asyncio.sleep(0)
                turn = time.monotonic()
        return readings

    def _note_drop(self, key: str, count: int) -> None:
        self.dropped += count
        if time.monotonic() >= self._drop_said:
            self._drop_said = time.monotonic() + REPEAT
            _log.warning(
                "sources.%s: samples of %s come faster than they can be taken; the %d oldest were dropped, %d of this "
                "source so far",
                self._name,
                key,
                count,
                self.dropped,
            )
