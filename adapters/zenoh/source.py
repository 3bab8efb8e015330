"""Live telemetry that the building management system publishes on Zenoh; nothing is ever put there."""

from __future__ import annotations

import logging
import time
from collections.abc import AsyncIterator, Sequence
from functools import partial

from adapters.channel import Binding
from adapters.errors import SourceUnavailable
from adapters.messages.inbox import Inbox, Incoming
from adapters.messages.subscribed import LOOK, QUIET, SubscribedSource
from adapters.reading import Batch, Probe
from adapters.zenoh.config import ZenohSourceConfig
from adapters.zenoh.connection import SessionConfig
from adapters.zenoh.link import ZenohLink, key_problem

LOST = 10.0
"""How long Zenoh itself may try to connect again before the session is closed and opened anew, in s."""

_log = logging.getLogger(__name__)


class ZenohSource(SubscribedSource):
    """Subscriptions of one session of its own.

    While the connection is lost Zenoh tries to connect again by itself; after LOST s, and where nobody answers to begin
    with, `batches` raises SourceUnavailable, and is to be called again.
    """

    def __init__(self, name: str, table: ZenohSourceConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, table, bindings, table.times, "key")
        self._table = table

    def check(self) -> list[str]:
        """Wrong key expressions, and files that cannot be read."""
        wrong = [
            f'{binding.id}: key "{binding.channel.place}" is no key expression: {problem}; write names joined by /, '
            'such as "bms/room1/T_air"'
            for binding in self._listed
            if (problem := key_problem(binding.channel.place))
        ]
        return [f"sources.{self.name}: {problem}" for problem in (*wrong, *self._table.problems())]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """What is published, for ever. `start` is of no concern. Raises SourceUnavailable and SourceConfigError."""
        inbox = self._begin()
        async with self._opened(self._made) as link:
            for key in self._channels.points:
                link.subscribe(key, partial(inbox.put, key), self._table.recover)
            watch = _Watch(self.name, self._table)
            look_at = time.monotonic()
            while True:
                async for batch in self._taken(inbox):
                    yield batch
                if time.monotonic() < look_at:
                    continue
                look_at = time.monotonic() + LOOK
                if self._rebound:
                    more, less = self._change(inbox)
                    for key in less:
                        await link.unsubscribe(key)
                    for key in more:
                        link.subscribe(key, partial(inbox.put, key), self._table.recover)
                if watch.joined(link.connected):
                    yield self._clock()
                if watch.quiet():
                    self._note_quiet()

    async def probe(self, seconds: float) -> list[Probe]:
        """What comes for every channel within `seconds`, published or in answer to a query; less if all have come."""
        channels = self._asked_for()
        keys = list(dict.fromkeys(channel.point for channel in channels))
        around = {f"{key.split('/', 1)[0]}/**" for key in keys}
        around = {key for key in around if not key.startswith(("*", "$"))}
        inbox = Inbox([*keys, *around], self._room)
        came: dict[str, list[Incoming]] = {key: [] for key in keys}
        heard: dict[str, str] = {}
        async with self._opened(self._made) as link:
            for key in around:
                link.subscribe(key, partial(inbox.put, key))
            for key in keys:
                link.subscribe(key, partial(inbox.put, key), last=True)
                link.ask(key, partial(inbox.put, key), seconds)
            end = time.monotonic() + seconds
            while (left := end - time.monotonic()) > 0 and not all(came.values()):
                await inbox.wait(left)
                for key, incoming, _ in inbox.waiting():
                    came.get(key, []).append(incoming)
                    heard[incoming.key] = incoming.key
            if not link.connected:
                raise SourceUnavailable(_nobody(self._table))
        nothing = f"nothing came within {seconds:g} s, and nobody answers a query; check key, and that it is published"
        return [self._probed(channel, came[channel.point], heard, nothing) for channel in channels]

    def _made(self) -> ZenohLink:
        return ZenohLink(self._table, self._table.access)


class _Watch:
    """Watches the connection of a session that has just been opened."""

    def __init__(self, name: str, table: SessionConfig) -> None:
        self._name, self._table = name, table
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
                _log.info("sources.%s: connected (%s)", self._name, self._table.place)
            else:
                _log.warning("sources.%s: the connection is lost; trying to connect again", self._name)
            return connected
        if not connected and now - self._since >= LOST:
            if not self._table.listen:
                raise SourceUnavailable(_nobody(self._table))
            if not self._alone_said:
                self._alone_said = True
                _log.warning("sources.%s: %s", self._name, _nobody(self._table))
        return False

    def quiet(self) -> bool:
        """Whether it is time, once, to say on which keys nothing has come."""
        if not self._connected or time.monotonic() < self._quiet_at:
            return False
        self._quiet_at = float("inf")
        return True


def _nobody(table: SessionConfig) -> str:
    if table.connect:
        return (
            f"there is no connection to {', '.join(table.connect)}; check that it is on, the address, and user, "
            "password and certificates"
        )
    return f"nobody has connected to {', '.join(table.listen)}; check the publisher's connect endpoints"
