"""Live telemetry that the building management system publishes on Zenoh; nothing is ever put there."""

import logging
from collections.abc import AsyncIterator, Collection, Sequence
from contextlib import asynccontextmanager
from functools import partial

from adapters.errors import SourceUnavailable
from adapters.messages.inbox import Inbox
from adapters.messages.subscribed import EVERYTHING, SubscribedSource
from adapters.zenoh.link import ZenohLink, key_problem

LOST = 10.0
"""How long Zenoh itself may try to connect again before the session is closed and opened anew, in s."""

_ASKED = 5.0
"""How long answers to a query may take while somebody looks, in s."""

_log = logging.getLogger(__name__)


class ZenohSource(SubscribedSource):
    """Subscriptions of a session of its own, which Zenoh connects again by itself; after LOST s, and where nobody
    answers to begin with, `batches` raises SourceUnavailable."""

    _nothing = "nobody answers a query; check key, and that it is published"
    _alone_said = False

    def check(self) -> list[str]:
        wrong = [
            f'sources.{self.name}: {binding.id}: key "{binding.channel.place}" is no key expression: {problem}; write '
            'names joined by /, such as "bms/room1/T_air"'
            for binding in self._listed
            if (problem := key_problem(binding.channel.place))
        ]
        return wrong + super().check()

    @asynccontextmanager
    async def _reached(self, inbox: Inbox, probed: Collection[str] | None = None) -> AsyncIterator[ZenohLink]:
        async with self._opened(lambda: ZenohLink(self._table, self._table.access)) as link:
            for key in probed or ():
                link.subscribe(key, partial(inbox.put, key), last=True)
                link.ask(key, partial(inbox.put, key), _ASKED)
            around = {f"{key.split('/', 1)[0]}/**" for key in probed or ()}
            for key in around - set(probed or ()):
                if not key.startswith(("*", "$")):
                    link.subscribe(key, partial(inbox.put, EVERYTHING))
            yield link

    async def _subscribe(self, link: ZenohLink, inbox: Inbox, keys: Sequence[str]) -> None:
        for key in keys:
            link.subscribe(key, partial(inbox.put, key), self._table.recover)

    async def _unsubscribe(self, link: ZenohLink, keys: Sequence[str]) -> None:
        for key in keys:
            await link.unsubscribe(key)

    def _connected(self, link: ZenohLink, seconds: float) -> bool:
        if link.connected:
            self._alone_said = False
        elif seconds >= LOST:
            if seconds == float("inf") or not self._table.listen:
                raise SourceUnavailable(self._nobody())
            # The session stays open for those who connect to us.
            if not self._alone_said:
                self._alone_said = True
                _log.warning("sources.%s: %s", self.name, self._nobody())
        return link.connected

    def _nobody(self) -> str:
        if self._table.connect:
            return (
                f"there is no connection to {', '.join(self._table.connect)}; check that it is on, the address, and "
                "user, password and certificates"
            )
        return f"nobody has connected to {', '.join(self._table.listen)}; check the publisher's connect endpoints"
