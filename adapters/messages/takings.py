"""What a source takes out of its inbox: readings, and a word about what had to be dropped."""

from __future__ import annotations

import logging
import time

from adapters.messages.inbox import Share
from adapters.messages.points import REPEAT, Channels
from adapters.reading import Reading

_log = logging.getLogger(__name__)


class Takings:
    """Makes readings of what has come for the `channels` of the source `name`."""

    def __init__(self, name: str, channels: Channels) -> None:
        self.dropped = 0
        """How many samples were dropped because they came faster than they could be taken."""
        self._name, self._channels = name, channels
        self._drop_said = float("-inf")

    def readings(self, shares: dict[str, Share]) -> list[Reading]:
        """The readings of `shares`, by key, with a bad one for every occasion on which samples were dropped."""
        readings: list[Reading] = []
        for key, share in shares.items():
            if share.dropped:
                self._note_drop(key, share.dropped)
                readings += self._channels.overrun(key, time.time())
            readings += self._channels.readings(key, share.samples)
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
