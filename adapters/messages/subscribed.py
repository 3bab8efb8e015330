"""What every source of subscriptions does, whatever carries the messages."""

from __future__ import annotations

import asyncio
import difflib
import logging
import time
from collections.abc import AsyncIterator, Mapping, Sequence

from adapters.channel import Binding
from adapters.messages.config import MessagesConfig
from adapters.messages.dating import Dating
from adapters.messages.inbox import Inbox, Incoming
from adapters.messages.points import MessageChannel, MessageChannels, probed
from adapters.reading import Batch, Fault, Probe, Reading
from adapters.watched import LiveSource, Seldom

TRANSIT = 1.0
"""How long a message may be on its way before the source's clock has gone past its time, in s."""

QUIET = 60.0
"""After this time with a connection it is said on which keys or topics nothing has come, in s."""

LOOK = 1.0
"""How long nothing is looked at but the inbox, at most, in s."""

SLICE_SECONDS = 0.004
"""How long the event loop is held before others have their turn; one sample at least is read in a turn."""

TOGETHER_SECONDS = 0.1
"""For how long readings are collected under a flood before they are delivered: every delivery concerns all zones."""

MOST_TOGETHER = 500
"""Readings that are delivered in a turn of the event loop, and from which on no more are collected."""

_SHOWN = 5

_log = logging.getLogger(__name__)


class SubscribedSource(LiveSource):
    """The channels of a source, and what comes for them. Messages go from the threads of a client library into an
    `Inbox`, so that neither side ever waits for the other."""

    def __init__(
        self, name: str, table: MessagesConfig, bindings: Sequence[Binding], times: tuple[str, ...], noun: str
    ) -> None:
        """`times` as of a Dating; `noun`: what the place is called that messages come on."""
        super().__init__(name, bindings)
        self.dropped = 0
        """How many messages were dropped because they came faster than they could be taken."""
        self._dating, self._noun = Dating(times, table.max_ahead), noun
        self._room, self._longest_stretch = table.queue, table.longest_stretch
        self._channels = MessageChannels(name, bindings, self._dating, table.longest_stretch, noun)
        self._seldom = Seldom()

    def _begin(self) -> Inbox:
        """The channels as they are listed now, with nothing heard yet, and an empty inbox for them."""
        self._channels.replace(self._listed)
        self._rebound = False
        self._channels.start_again()
        return Inbox(self._channels.points, self._room)

    def _change(self, inbox: Inbox) -> tuple[list[str], list[str]]:
        """Take channels and inbox to what is listed now; the keys that came and those that went."""
        self._rebound, before = False, self._channels.points
        self._channels.replace(self._listed)
        now = self._channels.points
        inbox.listen_to(now)
        return [key for key in now if key not in before], [key for key in before if key not in now]

    def _clock(self) -> Batch:
        """A batch that tells the time alone."""
        return Batch([], time.time() - TRANSIT)

    async def _taken(self, inbox: Inbox) -> AsyncIterator[Batch]:
        """What comes within LOOK s, in pieces: a single message may hold thousands of readings."""
        if await inbox.wait(LOOK):
            readings = await self._readings(inbox)
            for first in range(0, max(len(readings), 1), MOST_TOGETHER):
                yield Batch(readings[first : first + MOST_TOGETHER], time.time() - TRANSIT)
                # A flood must leave the loop to others as well.
                await asyncio.sleep(0)

    async def _readings(self, inbox: Inbox) -> list[Reading]:
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
        if self._seldom("dropped"):
            say = "sources.%s: samples of %s come faster than they can be taken; the %d oldest were dropped, %d of this"
            _log.warning(f"{say} source so far", self.name, key, count, self.dropped)

    def _note_quiet(self) -> None:
        for channel in self._channels.unheard():
            say = "sources.%s: nothing has come for %s so far; check its %s with thermogate probe"
            _log.warning(say, self.name, channel, self._noun)

    def _asked_for(self) -> list[MessageChannel]:
        """The channels that are listed, for one look at each."""
        return [MessageChannel(binding, self._longest_stretch) for binding in self._listed]

    def _probed(
        self, channel: MessageChannel, came: Sequence[Incoming], heard: Mapping[str, str], nothing: str
    ) -> Probe:
        """What a person should know of what `came` for `channel`, with the verdict `nothing` if nothing did, and what
        was `heard` on places like its own."""
        probe = probed(channel, self._dating, came, nothing)
        if came or not heard:
            return probe
        near = difflib.get_close_matches(channel.point, sorted(heard), n=_SHOWN, cutoff=0.0)
        return probe._replace(hints=tuple(f"heard meanwhile: {heard[place]}" for place in near))
