"""What every source of subscriptions does, whatever carries the messages."""

import asyncio
import difflib
import logging
import time
from collections.abc import AsyncIterator, Collection, Iterator, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Any

from adapters.channel import Binding
from adapters.messages.config import MessagesConfig
from adapters.messages.decoding import numbers_in, shown
from adapters.messages.inbox import MOST_BYTES, Inbox, Incoming
from adapters.messages.points import MessageChannel, MessageChannels
from adapters.reading import Batch, Fault, Probe, Reading
from adapters.watched import LiveSource, Seldom

TRANSIT = 1.0
"""How long a message may be on its way before the source's clock has gone past its time, in s."""

QUIET = 60.0
"""After this time with a connection it is said on which keys or topics nothing has come, in s."""

LOOK = 1.0
"""How long nothing is looked at but the inbox, at most, in s."""

SLICE_SECONDS = 0.004
"""How long the event loop is held, and one message read, before others have their turn; a reading at least comes of a
turn."""

TOGETHER_SECONDS = 0.1
"""For how long readings are collected under a flood before they are delivered: every delivery concerns all zones."""

MOST_TOGETHER = 500
"""Readings that are delivered in a turn of the event loop, and from which on no more are collected."""

EVERYTHING = "#"
"""The key of an inbox for whatever comes elsewhere, while somebody looks."""

MOST_PLACES = 2000
"""Keys or topics that are kept of all that is published while somebody looks."""

_SHOWN = 5

_log = logging.getLogger(__name__)


class SubscribedSource(LiveSource):
    """The channels of a source, whose messages go from the threads of a client library into an `Inbox`. A kind of
    source says how its link is opened, subscribed and watched (the methods below `scan`)."""

    def __init__(self, name: str, table: MessagesConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, bindings)
        self.dropped = 0
        """How many messages were dropped because they came faster than they could be taken."""
        self._table: Any = table
        self._channels = MessageChannels(name, bindings, table)
        self._begun: dict[str, tuple[Incoming, Iterator[Reading]]] = {}
        """Messages that many channels read, or that hold much, by key, and the readings of them that are to come."""
        self._seldom = Seldom()

    def check(self) -> list[str]:
        return [f"sources.{self.name}: {problem}" for problem in self._table.problems()]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        self._channels.replace(self._listed)
        self._channels.start_again()
        self._begun.clear()
        self._rebound = False
        inbox = Inbox(self._channels.points, self._table.queue)
        async with self._reached(inbox) as link:
            await self._subscribe(link, inbox, self._channels.points)
            connected, since, look_at, quiet_at = False, time.monotonic(), 0.0, float("inf")
            while True:
                async for batch in self._taken(inbox):
                    yield batch
                if (now := time.monotonic()) >= look_at:
                    look_at = now + LOOK
                    if self._rebound:
                        await self._change(link, inbox)
                    before, connected = connected, self._connected(link, now - since)
                    if connected != before:
                        since, quiet_at = now, now + QUIET if connected else float("inf")
                        if connected:
                            _log.info("sources.%s: connected (%s)", self.name, self._table.place)
                            yield Batch([], time.time() - TRANSIT)
                        else:
                            _log.warning("sources.%s: the connection is lost; trying to connect again", self.name)
                    if now >= quiet_at:
                        quiet_at = float("inf")
                        self._note_quiet()

    async def probe(self, seconds: float) -> list[Probe]:
        """What comes for every channel within `seconds`, or is kept for who asks; less if all have come."""
        channels = [MessageChannel(binding, self._table) for binding in self._listed]
        came, heard = await self._listen({channel.point for channel in channels}, seconds)
        nothing = f"nothing came within {seconds:g} s, and {self._nothing}"
        return [self._probed(channel, came[channel.point], heard, nothing) for channel in channels]

    async def _listen(
        self, points: Collection[str], seconds: float
    ) -> tuple[dict[str, list[Incoming]], dict[str, Incoming]]:
        """What comes on each of `points`, until all have had one, and the newest on others, within `seconds`."""
        inbox = Inbox([*points, EVERYTHING], max(self._table.queue, MOST_PLACES), MOST_BYTES)
        came: dict[str, list[Incoming]] = {point: [] for point in points}
        heard: dict[str, Incoming] = {}
        async with self._reached(inbox, points) as link:
            end = time.monotonic() + seconds
            while (left := end - time.monotonic()) > 0 and not (came and all(came.values())):
                await inbox.wait(min(left, LOOK))
                for key, incoming, _ in inbox.waiting():
                    came.get(key, []).append(incoming)
                    new = key == EVERYTHING and incoming.key not in heard
                    if not new or (len(heard) < MOST_PLACES and not published_here(incoming.key)):
                        heard[incoming.key] = incoming
                self._connected(link, 0.0)
            self._connected(link, float("inf"))
        return came, heard

    def _probed(
        self, channel: MessageChannel, came: Sequence[Incoming], heard: dict[str, Incoming], nothing: str
    ) -> Probe:
        """What a person should know of what `came` for `channel`, with the verdict `nothing` if nothing did, and what
        was `heard` on places like its own."""
        probe = channel.look(came, nothing)
        if came or not heard:
            return probe
        near = difflib.get_close_matches(channel.point, sorted(heard), n=_SHOWN, cutoff=0.0)
        return probe._replace(hints=tuple(f"heard meanwhile: {described(heard[place])}" for place in near))

    _nothing: str
    """What else did not come while somebody looked, and the remedy."""

    def _reached(self, inbox: Inbox, probed: Collection[str] | None = None) -> AbstractAsyncContextManager[Any]:
        """The open link, whose messages go into `inbox`. `probed`: somebody looks at these places; subscribed to them
        and to what is around them, under EVERYTHING."""
        raise NotImplementedError

    async def _subscribe(self, link: Any, inbox: Inbox, keys: Sequence[str]) -> None:
        raise NotImplementedError

    async def _unsubscribe(self, link: Any, keys: Sequence[str]) -> None:
        raise NotImplementedError

    def _connected(self, link: Any, seconds: float) -> bool:
        """Whether somebody is at the other end. Raises SourceUnavailable if nobody has been for `seconds` and that is
        too long."""
        raise NotImplementedError

    async def _change(self, link: Any, inbox: Inbox) -> None:
        """Take channels, inbox and subscriptions to what is listed now."""
        self._rebound, before = False, self._channels.points
        self._channels.replace(self._listed)
        self._begun.clear()
        now = self._channels.points
        inbox.listen_to(now)
        await self._unsubscribe(link, [key for key in before if key not in now])
        await self._subscribe(link, inbox, [key for key in now if key not in before])

    async def _taken(self, inbox: Inbox) -> AsyncIterator[Batch]:
        if await inbox.wait(LOOK):
            yield Batch(await self._readings(inbox), time.time() - TRANSIT)
            # A flood must leave the loop to others as well.
            await asyncio.sleep(0)

    async def _readings(self, inbox: Inbox) -> list[Reading]:
        """The readings of what waits in `inbox`, as far as they go together, with a bad one for every occasion on which
        samples were dropped. A message may hold thousands for each of many channels: keys take turns within it too."""
        readings: list[Reading] = []
        turn = begun = time.monotonic()
        for key, incoming, dropped in inbox.waiting():
            if dropped:
                self.dropped += dropped
                if self._seldom("dropped"):
                    say = "sources.%s: samples of %s come faster than they can be taken; the %d oldest were dropped"
                    _log.warning(f"{say}, %d of this source so far", self.name, key, dropped, self.dropped)
                readings += self._channels.bad(key, Fault.OVERRUN)
            before, coming = self._begun.pop(key, (None, iter(())))
            if before is not incoming:
                coming = self._channels.came(key, incoming)
            for reading in coming:
                readings.append(reading)
                now = time.monotonic()
                if len(readings) >= MOST_TOGETHER or now - turn >= SLICE_SECONDS:
                    self._begun[key] = incoming, coming
                    inbox.put_back(key, incoming)
                    break
            now = time.monotonic()
            if len(readings) >= MOST_TOGETHER or now - begun >= TOGETHER_SECONDS:
                break
            if now - turn >= SLICE_SECONDS:
                await asyncio.sleep(0)
                turn = time.monotonic()
        return readings

    def _note_quiet(self) -> None:
        for channel in self._channels.all():
            if not channel.heard:
                noun = channel.form.noun
                say = "sources.%s: nothing has come for %s (%s %s) so far; check its %s with thermogate probe"
                _log.warning(say, self.name, channel.id, noun, channel.point, noun)


def published_here(place: str) -> bool:
    """Whether Thermogate publishes there itself: results of zones, and what Home Assistant discovers them by."""
    first, *rest = place.split("/")
    return first == "thermogate" or (place.endswith("/config") and any(part.startswith("thermogate_") for part in rest))


def described(incoming: Incoming) -> str:
    found = numbers_in(incoming.payload or b"")
    if found and found[0][0]:
        return f"{incoming.key} with {', '.join(f'{pointer} {number:g}' for pointer, number in found)}"
    return f"{incoming.key} with {shown(incoming.payload or b'')}"
