"""Live telemetry that devices publish on an MQTT broker."""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager

from adapters.channel import Binding
from adapters.errors import SourceUnavailable, said_of
from adapters.messages.inbox import MOST_BYTES, Inbox, Incoming
from adapters.messages.subscribed import LOOK, QUIET, SubscribedSource
from adapters.mqtt.broker import BrokerConfig
from adapters.mqtt.client import Client, Will, connected
from adapters.mqtt.config import MqttSourceConfig
from adapters.mqtt.scan import MOST_TOPICS, published_here, scanned
from adapters.payload.payload import numbers_in, shown
from adapters.reading import Batch, Probe
from adapters.scanning import Scan, Scanned

EVERYTHING = "#"
ONLINE, OFFLINE = b"online", b"offline"

_CLOSE_SECONDS = 1.0

_log = logging.getLogger(__name__)


class MqttSource(SubscribedSource):
    """Subscriptions of one client, which runs in a thread of its own. Where the connection is lost `batches` raises
    SourceUnavailable, and is to be called again."""

    def __init__(self, name: str, table: MqttSourceConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, table, bindings, table.times, "topic")
        self._table: MqttSourceConfig = table.called(f"thermogate-{name}")

    def check(self) -> list[str]:
        """Files that cannot be read, and a missing client library."""
        return [f"sources.{self.name}: {problem}" for problem in self._table.problems()]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """What is published, for ever. `start` is of no concern. Raises SourceUnavailable and SourceConfigError."""
        inbox = self._begin()
        async with self._reached(self._table, inbox, self._topics(), self._table.session) as link:
            _log.info("sources.%s: connected (%s)", self.name, self._table.place)
            yield self._clock()
            quiet_at = time.monotonic() + QUIET
            while True:
                async for batch in self._taken(inbox):
                    yield batch
                link.check()
                if self._rebound:
                    more, less = self._change(inbox)
                    topics = self._topics()
                    await link.subscribe({topic: topics[topic] for topic in more})
                    await link.unsubscribe(less)
                if time.monotonic() >= quiet_at:
                    quiet_at = float("inf")
                    self._note_quiet()

    async def probe(self, seconds: float) -> list[Probe]:
        """What comes for every channel within `seconds`, or was retained; less if all have come."""
        channels = self._asked_for()
        heard = await self._listen({channel.point for channel in channels}, seconds)
        nothing = f"nothing came within {seconds:g} s, and nothing was retained; check topic, and that it is published"
        came = {topic: [incoming] for topic, incoming in heard.items()}
        around = {topic: _described(incoming) for topic, incoming in heard.items()}
        return [self._probed(channel, came.get(channel.point, ()), around, nothing) for channel in channels]

    async def scan(self, wanted: Scan) -> Scanned:
        """Every topic of others on which something comes within the time of `wanted`, or was retained."""
        return scanned(await self._listen(set(), wanted.seconds), wanted.seconds)

    async def _listen(self, topics: set[str], seconds: float) -> dict[str, Incoming]:
        """The newest message of every topic of others, MOST_TOPICS of them, and of `topics`, until all of the latter
        have had one, `seconds` at most."""
        inbox = Inbox([EVERYTHING], max(self._room, MOST_TOPICS), MOST_BYTES)
        # Under its own name it would take the place of the daemon.
        broker = self._table.model_copy(update={"client_id": f"thermogate-probe-{secrets.token_hex(4)}"})
        heard: dict[str, Incoming] = {}
        async with self._reached(broker, inbox, {EVERYTHING: 0, **dict.fromkeys(topics, 0)}, 0.0) as link:
            end = time.monotonic() + seconds
            while (left := end - time.monotonic()) > 0 and not (topics and topics <= heard.keys()):
                await inbox.wait(min(left, LOOK))
                for _, incoming, _ in inbox.waiting():
                    unknown = incoming.key not in topics and incoming.key not in heard
                    if not unknown or (len(heard) < MOST_TOPICS and not published_here(incoming.key)):
                        heard[incoming.key] = incoming
                link.check()
        return heard

    @asynccontextmanager
    async def _reached(
        self, broker: BrokerConfig, inbox: Inbox, topics: Mapping[str, int], session: float
    ) -> AsyncIterator[Client]:
        """A client of `broker` with subscriptions to `topics`, whose messages go into `inbox`."""
        status = self._table.status_topic if session else None

        def take(incoming: Incoming) -> None:
            inbox.put(EVERYTHING if EVERYTHING in topics else incoming.key, incoming)

        with said_of(self.name):
            async with connected(broker, take, session, None if status is None else Will(status, OFFLINE)) as client:
                self._link = client
                if status is not None:
                    await client.publish(status, ONLINE)
                await client.subscribe(topics)
                try:
                    yield client
                finally:
                    if status is not None:
                        await _said_goodbye(client, status)

    def _topics(self) -> dict[str, int]:
        """The topics, each with the quality of service of its subscription.

        What waits at the broker while the connection is lost must say itself of when it is. A value without a time
        would be dated when the connection is back; it is therefore not waited with. Whether a SenML pack has a time is
        not known before it is there: it is taken to have one, since what does not wait is lost for good.
        """
        wanted: dict[str, int] = {}
        for channel in (binding.channel for binding in self._listed):
            timed = "payload" in self._table.times and (channel.time is not None or channel.format == "senml")
            qos = int(timed) if self._table.qos is None else self._table.qos
            wanted[channel.place] = max(qos, wanted.get(channel.place, 0))
        return wanted


async def _said_goodbye(client: Client, topic: str) -> None:
    """An orderly end leaves no will."""
    try:
        async with asyncio.timeout(_CLOSE_SECONDS / 2):
            await client.publish(topic, OFFLINE)
    except (SourceUnavailable, TimeoutError):
        _log.debug("%s could not be told that the source is offline", topic)


def _described(incoming: Incoming) -> str:
    """A topic, and what could be read there."""
    found = numbers_in(incoming.payload or b"")
    if found and found[0][0]:
        return f"{incoming.key} with {', '.join(f'{pointer} {number:g}' for pointer, number in found)}"
    return f"{incoming.key} with {shown(incoming.payload or b'')}"
