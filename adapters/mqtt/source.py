"""Live telemetry that devices publish on an MQTT broker."""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from functools import partial
from typing import Any

from adapters.channel import Binding
from adapters.errors import SourceUnavailable
from adapters.messages.inbox import MOST_BYTES, Inbox, Incoming
from adapters.messages.subscribed import LOOK, QUIET, SubscribedSource
from adapters.mqtt.background import Background
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
                    link.change({topic: topics[topic] for topic in more}, set(less))
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

    def _reached(
        self, broker: BrokerConfig, inbox: Inbox, topics: Mapping[str, int], session: float
    ) -> AbstractAsyncContextManager[_Link]:
        status_topic = self._table.status_topic if session else None
        return self._opened(lambda: _Link(self.name, broker, inbox, topics, session, status_topic))

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


class _Link:
    """The client of a source, in a thread of its own."""

    def __init__(
        self,
        name: str,
        broker: BrokerConfig,
        inbox: Inbox,
        topics: Mapping[str, int],
        session: float,
        status_topic: str | None,
    ) -> None:
        self._broker, self._inbox, self._session, self._status_topic = broker, inbox, session, status_topic
        self._topics = dict(topics)
        self._client: Client | None = None
        self._loop = asyncio.get_running_loop()
        self._is_open = asyncio.Event()
        self._changes: asyncio.Queue[tuple[Mapping[str, int], set[str]]] = asyncio.Queue()
        self._everything = EVERYTHING in topics
        self._background = Background(f"mqtt-{name}")

    async def open(self) -> None:
        """Connect and subscribe. Raises SourceUnavailable and SourceConfigError."""
        self._background.start(self._attend)
        while not self._is_open.is_set():
            try:
                async with asyncio.timeout(LOOK / 10):
                    await self._is_open.wait()
            except TimeoutError:
                self.check()

    def check(self) -> None:
        """Raise why the connection is lost, if it is."""
        if self._background.failure is not None:
            raise self._background.failure
        if self._background.ended:
            raise SourceUnavailable(f"the connection to {self._broker.place} has ended")

    def change(self, more: Mapping[str, int], less: set[str]) -> None:
        """Subscribe to the topics `more` with their quality of service, and give `less` up."""
        self._background.call(partial(self._changes.put_nowait, (more, less)))

    async def close(self) -> None:
        """Disconnect; gives up after a second rather than hang."""
        await asyncio.to_thread(self._background.stop, _CLOSE_SECONDS)

    async def _attend(self) -> None:
        topic = self._status_topic
        will = None if topic is None else Will(topic, OFFLINE)
        async with connected(self._broker, self._take, self._session, will) as client:
            if topic is not None:
                await client.publish(topic, ONLINE)
            await client.subscribe(self._topics)
            self._loop.call_soon_threadsafe(self._is_open.set)
            try:
                await _first_failure(client.lost(), self._follow(client))
            finally:
                if topic is not None:
                    await _said_goodbye(client, topic)

    async def _follow(self, client: Client) -> None:
        """Take the subscriptions to every change. Raises SourceUnavailable where the broker does not confirm one."""
        while True:
            more, less = await self._changes.get()
            await client.subscribe(more)
            await client.unsubscribe(less)

    def _take(self, incoming: Incoming) -> None:
        self._inbox.put(EVERYTHING if self._everything else incoming.key, incoming)


async def _first_failure(*work: Coroutine[Any, Any, None]) -> None:
    """Run `work`, which never ends by itself, until one of it raises, and raise that; none of it is left behind."""
    tasks = [asyncio.create_task(one) for one in work]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            if task.done():
                task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


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
