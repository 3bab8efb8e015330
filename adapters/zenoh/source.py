"""Live telemetry that the building management system publishes on Zenoh; nothing is ever put there."""

from __future__ import annotations

import asyncio
import difflib
import logging
import time
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass, field
from functools import partial

from adapters.errors import SourceConfigError, SourceError, SourceUnavailable
from adapters.messages.inbox import Inbox, Incoming
from adapters.messages.points import Channels, Dating, MessageChannel, probed
from adapters.messages.takings import Takings, pieces
from adapters.reading import Batch, Probe
from adapters.zenoh.connection import Connection
from adapters.zenoh.link import ZenohLink, key_problem

TRANSIT = 1.0
"""How long a sample may be on its way before the source's clock has gone past its time, in s."""

LOST = 10.0
"""How long Zenoh itself may try to connect again before the session is closed and opened anew, in s."""

QUIET = 60.0
"""After this time with a connection it is said on which keys nothing has come, in s."""

_LOOK = 1.0
_KEYS_SHOWN = 5

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Intake:
    """How samples are taken in.

    Readings are dated by `dating`; samples missed while the connection was lost are recovered up to the age `recover`
    (s) from publishers that keep a cache; `queue` samples wait at most per key; and no power is made of counts further
    apart than `longest_stretch` s.
    """

    dating: Dating = field(default_factory=Dating)
    recover: float = 0.0
    queue: int = 1000
    longest_stretch: float = 900.0


class ZenohSource:
    """Subscriptions of one session of its own.

    While the connection is lost Zenoh tries to connect again by itself; after LOST s, and where nobody answers to begin
    with, `batches` raises SourceUnavailable, and is to be called again. Samples go from Zenoh's threads into an
    `Inbox`, so that neither side ever waits for the other.
    """

    def __init__(self, name: str, connection: Connection, channels: Sequence[MessageChannel], intake: Intake) -> None:
        self.name = name
        self._connection, self._intake = connection, intake
        self._listed = tuple(channels)
        self._channels = Channels(channels, intake.dating, intake.longest_stretch)
        self._takings = Takings(name, self._channels)
        self._rebound = False
        """Whether `_listed` has changed since the last look."""
        self._link: ZenohLink | None = None

    @property
    def dropped(self) -> int:
        """How many samples were dropped because they came faster than they could be taken."""
        return self._takings.dropped

    def check(self) -> list[str]:
        """Wrong key expressions, and files that cannot be read."""
        wrong = [
            f'{channel.id}: key "{channel.key}" is no key expression: {problem}; write names joined by /, such as '
            '"bms/room1/T_air"'
            for channel in self._listed
            if (problem := key_problem(channel.key))
        ]
        return [f"sources.{self.name}: {problem}" for problem in (*wrong, *self._connection.problems())]

    def rebind(self, channels: Sequence[MessageChannel]) -> None:
        """Deliver `channels` from the next look on, over the same session."""
        self._listed, self._rebound = tuple(channels), True

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """What is published, for ever. `start` is of no concern. Raises SourceUnavailable and SourceConfigError."""
        self._channels.replace(self._listed)
        self._rebound = False
        inbox = Inbox(self._channels.keys, self._intake.queue)
        self._channels.start_again()
        link = await self._open()
        try:
            for key in self._channels.keys:
                link.subscribe(key, partial(inbox.put, key), self._intake.recover)
            watch = _Watch(self.name, self._connection)
            look_at = time.monotonic()
            while True:
                if await inbox.wait(_LOOK):
                    for readings in pieces(await self._takings.readings(inbox)):
                        yield Batch(readings, time.time() - TRANSIT)
                        # A flood must leave the loop to others as well.
                        await asyncio.sleep(0)
                if time.monotonic() < look_at:
                    continue
                look_at = time.monotonic() + _LOOK
                if self._rebound:
                    await self._listen_anew(link, inbox)
                if watch.joined(link.connected):
                    yield Batch([], time.time() - TRANSIT)
                if watch.quiet():
                    for channel in self._channels.unheard():
                        _log.warning(
                            "sources.%s: nothing has come for %s so far; check its key with thermogate probe",
                            self.name,
                            channel,
                        )
        except SourceUnavailable as error:
            raise SourceUnavailable(f"sources.{self.name}: {error}") from error
        finally:
            await link.close()

    async def probe(self, seconds: float) -> list[Probe]:
        """What comes for every channel within `seconds`, published or in answer to a query; less if all have come."""
        around = {f"{channel.key.split('/', 1)[0]}/**" for channel in self._listed}
        around = {key for key in around if not key.startswith(("*", "$"))}
        inbox = Inbox([*self._channels.keys, *around], self._intake.queue)
        link = await self._open()
        came: dict[str, list[Incoming]] = {key: [] for key in self._channels.keys}
        heard: set[str] = set()
        try:
            for key in around:
                link.subscribe(key, partial(inbox.put, key))
            for key in self._channels.keys:
                link.subscribe(key, partial(inbox.put, key), last=True)
                link.ask(key, partial(inbox.put, key), seconds)
            end = time.monotonic() + seconds
            while (left := end - time.monotonic()) > 0 and not all(came.values()):
                await inbox.wait(left)
                for key, incoming, _ in inbox.waiting():
                    came.get(key, []).append(incoming)
                    heard.add(incoming.key)
            if not link.connected:
                raise SourceUnavailable(_nobody(self._connection))
        except SourceUnavailable as error:
            raise SourceUnavailable(f"sources.{self.name}: {error}") from error
        finally:
            await link.close()
        return [self._probed(channel, came[channel.key], heard, seconds) for channel in self._listed]

    async def close(self) -> None:
        """Close the session; safe to call twice."""
        if self._link is not None:
            await self._link.close()

    async def _open(self) -> ZenohLink:
        for problem in self.check():
            raise SourceConfigError(problem)
        try:
            self._link = await ZenohLink.open(self._connection)
        except SourceError as error:
            raise type(error)(f"sources.{self.name}: {error}") from error
        return self._link

    async def _listen_anew(self, link: ZenohLink, inbox: Inbox) -> None:
        """Take the subscriptions from those of the channels there were to those of the channels there are."""
        self._rebound = False
        before = self._channels.keys
        self._channels.replace(self._listed)
        inbox.listen_to(self._channels.keys)
        for key in before:
            if key not in self._channels.keys:
                await link.unsubscribe(key)
        for key in self._channels.keys:
            if key not in before:
                link.subscribe(key, partial(inbox.put, key), self._intake.recover)

    def _probed(self, channel: MessageChannel, samples: list[Incoming], heard: set[str], seconds: float) -> Probe:
        nothing = f"nothing came within {seconds:g} s, and nobody answers a query; check key, and that it is published"
        probe = probed(channel, self._intake.dating, samples, nothing)
        if samples or not heard:
            return probe
        near = difflib.get_close_matches(channel.key, sorted(heard), n=_KEYS_SHOWN, cutoff=0.0)
        return probe._replace(hints=(f"heard meanwhile: {', '.join(near)}",))


class _Watch:
    """Watches the connection of a session that has just been opened."""

    def __init__(self, name: str, connection: Connection) -> None:
        self._name, self._connection = name, connection
        self._connected = False
        self._since = time.monotonic()
        self._quiet_at = float("inf")
        self._alone_said = False

    def joined(self, connected: bool) -> bool:
        """Whether it is `connected` for the first time since it was not. Raises SourceUnavailable once it has not been
        for LOST s; where others connect to us the session stays open for them, and it is only said."""
        now = time.monotonic()
        if connected != self._connected:
            self._connected, self._since, self._alone_said = connected, now, False
            if connected:
                self._quiet_at = now + QUIET
                _log.info("sources.%s: connected (%s)", self._name, self._connection.place)
            else:
                _log.warning("sources.%s: the connection is lost; trying to connect again", self._name)
            return connected
        if not connected and now - self._since >= LOST:
            if not self._connection.listen:
                raise SourceUnavailable(_nobody(self._connection))
            if not self._alone_said:
                self._alone_said = True
                _log.warning("sources.%s: %s", self._name, _nobody(self._connection))
        return False

    def quiet(self) -> bool:
        """Whether it is time, once, to say on which keys nothing has come."""
        if not self._connected or time.monotonic() < self._quiet_at:
            return False
        self._quiet_at = float("inf")
        return True


def _nobody(connection: Connection) -> str:
    if connection.connect:
        return (
            f"there is no connection to {', '.join(connection.connect)}; check that it is on, the address, and user, "
            "password and certificates"
        )
    return f"nobody has connected to {', '.join(connection.listen)}; check the publisher's connect endpoints"
