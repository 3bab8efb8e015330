"""Live telemetry that devices publish on an MQTT broker."""

from __future__ import annotations

import asyncio
import difflib
import logging
import secrets
import time
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from adapters.errors import SourceConfigError, SourceError, SourceUnavailable
from adapters.messages.inbox import MOST_BYTES, Inbox, Incoming
from adapters.messages.points import Channels, Dating, MessageChannel, probed
from adapters.messages.takings import Takings, pieces
from adapters.mqtt.background import Background
from adapters.mqtt.broker import Broker, topic_problem
from adapters.mqtt.client import Client, Will, connected
from adapters.mqtt.scan import MOST_TOPICS, published_here, scanned
from adapters.payload.payload import numbers_in, shown
from adapters.reading import Batch, Probe
from adapters.scanning import Scan, Scanned

TIMES = ("payload", "arrival")
"""Where the time of a reading can come from."""

TRANSIT = 1.0
"""How long a message may be on its way before the source's clock has gone past its time, in s."""

QUIET = 60.0
"""After this time with a connection it is said on which topics nothing has come, in s."""

EVERYTHING = "#"
ONLINE, OFFLINE = b"online", b"offline"

_LOOK = 1.0
_CLOSE_SECONDS = 1.0
_TOPICS_SHOWN = 5

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Intake:
    """How messages are taken in.

    Readings are dated by `dating`. The broker keeps the session for `session` s after the connection is lost; `qos`
    is the quality of service of every subscription, None what its channel can make use of. `queue` messages wait at
    most per topic; no power is made of counts further apart than `longest_stretch` s. `status_topic` says, retained,
    whether this source is connected.
    """

    dating: Dating = field(default_factory=lambda: Dating(TIMES))
    session: float = 3600.0
    qos: int | None = None
    queue: int = 1000
    longest_stretch: float = 900.0
    status_topic: str | None = None


class MqttSource:
    """Subscriptions of one client.

    The client runs in a thread of its own and puts messages into an `Inbox`, so that neither side ever waits for the
    other. Where the connection is lost `batches` raises SourceUnavailable, and is to be called again.
    """

    def __init__(self, name: str, broker: Broker, channels: Sequence[MessageChannel], intake: Intake) -> None:
        self.name = name
        self._broker, self._intake = broker, intake
        self._listed = tuple(channels)
        self._channels = Channels(channels, intake.dating, intake.longest_stretch, "topic")
        self._takings = Takings(name, self._channels)
        self._rebound = False
        """Whether `_listed` has changed since the last look."""
        self._link: _Link | None = None

    @property
    def dropped(self) -> int:
        """How many messages were dropped because they came faster than they could be taken."""
        return self._takings.dropped

    def check(self) -> list[str]:
        """Wrong topics, files that cannot be read, and a missing client library."""
        wrong = [
            f'{channel.id}: topic "{channel.key}" {problem}'
            for channel in self._listed
            if (problem := topic_problem(channel.key))
        ]
        return [f"sources.{self.name}: {problem}" for problem in (*wrong, *self._broker.problems())]

    def rebind(self, channels: Sequence[MessageChannel]) -> None:
        """Deliver `channels` from the next look on, over the same connection."""
        self._listed, self._rebound = tuple(channels), True

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """What is published, for ever. `start` is of no concern. Raises SourceUnavailable and SourceConfigError."""
        self._channels.replace(self._listed)
        self._rebound = False
        self._channels.start_again()
        inbox = Inbox(self._channels.keys, self._intake.queue)
        link = self._open(self._broker, inbox, self._topics(), self._intake.session)
        try:
            await link.opened()
            _log.info("sources.%s: connected (%s)", self.name, self._broker.place)
            yield Batch([], time.time() - TRANSIT)
            quiet_at = time.monotonic() + QUIET
            while True:
                if await inbox.wait(_LOOK):
                    for readings in pieces(await self._takings.readings(inbox)):
                        yield Batch(readings, time.time() - TRANSIT)
                        # A flood must leave the loop to others as well.
                        await asyncio.sleep(0)
                link.check()
                if self._rebound:
                    self._listen_anew(link, inbox)
                if time.monotonic() >= quiet_at:
                    quiet_at = float("inf")
                    self._note_silence()
        except SourceError as error:
            raise type(error)(f"sources.{self.name}: {error}") from error
        finally:
            await link.close()

    async def probe(self, seconds: float) -> list[Probe]:
        """What comes for every channel within `seconds`, or was retained; less if all have come."""
        topics = {channel.key for channel in self._listed}
        heard = await self._listen(topics, seconds)
        return [self._probed(channel, heard, seconds) for channel in self._listed]

    async def scan(self, wanted: Scan) -> Scanned:
        """Every topic of others on which something comes within the time of `wanted`, or was retained."""
        return scanned(await self._listen(set(), wanted.seconds), wanted.seconds)

    async def _listen(self, topics: set[str], seconds: float) -> dict[str, Incoming]:
        """The newest message of every topic of others, MOST_TOPICS of them, and of `topics`, until all of the latter
        have had one, `seconds` at most."""
        inbox = Inbox([EVERYTHING], max(self._intake.queue, MOST_TOPICS), MOST_BYTES)
        # Under its own name it would take the place of the daemon.
        broker = replace(self._broker, client_id=f"thermogate-probe-{secrets.token_hex(4)}")
        link = self._open(broker, inbox, {EVERYTHING: 0, **dict.fromkeys(topics, 0)}, 0.0)
        heard: dict[str, Incoming] = {}
        try:
            await link.opened()
            end = time.monotonic() + seconds
            while (left := end - time.monotonic()) > 0 and not (topics and topics <= heard.keys()):
                await inbox.wait(min(left, _LOOK))
                for _, incoming, _ in inbox.waiting():
                    unknown = incoming.key not in topics and incoming.key not in heard
                    if not unknown or (len(heard) < MOST_TOPICS and not published_here(incoming.key)):
                        heard[incoming.key] = incoming
                link.check()
        except SourceError as error:
            raise type(error)(f"sources.{self.name}: {error}") from error
        finally:
            await link.close()
        return heard

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
        if self._link is not None:
            await self._link.close()

    def _open(self, broker: Broker, inbox: Inbox, topics: Mapping[str, int], session: float) -> _Link:
        for problem in self.check():
            raise SourceConfigError(problem)
        self._link = _Link(self.name, broker, inbox, topics, session, self._intake.status_topic if session else None)
        return self._link

    def _topics(self) -> dict[str, int]:
        """The topics, each with the quality of service of its subscription.

        What waits at the broker while the connection is lost must say itself of when it is. A value without a time
        would be dated when the connection is back; it is therefore not waited with. Whether a SenML pack has a time is
        not known before it is there: it is taken to have one, since what does not wait is lost for good.
        """
        wanted: dict[str, int] = {}
        for channel in self._listed:
            timed = "payload" in self._intake.dating.times and (
                channel.format.time is not None or channel.format.kind == "senml"
            )
            qos = int(timed) if self._intake.qos is None else self._intake.qos
            wanted[channel.key] = max(qos, wanted.get(channel.key, 0))
        return wanted

    def _listen_anew(self, link: _Link, inbox: Inbox) -> None:
        """Take the subscriptions from those of the channels there were to those of the channels there are."""
        self._rebound = False
        before = set(self._channels.keys)
        self._channels.replace(self._listed)
        inbox.listen_to(self._channels.keys)
        now = self._topics()
        link.change({topic: qos for topic, qos in now.items() if topic not in before}, before - now.keys())

    def _note_silence(self) -> None:
        for channel in self._channels.unheard():
            _log.warning(
                "sources.%s: nothing has come for %s so far; check its topic with thermogate probe", self.name, channel
            )

    def _probed(self, channel: MessageChannel, heard: Mapping[str, Incoming], seconds: float) -> Probe:
        samples = [heard[channel.key]] if channel.key in heard else []
        nothing = f"nothing came within {seconds:g} s, and nothing was retained; check topic, and that it is published"
        probe = probed(channel, self._intake.dating, samples, nothing)
        if samples or not heard:
            return probe
        near = difflib.get_close_matches(channel.key, sorted(heard), n=_TOPICS_SHOWN, cutoff=0.0)
        return probe._replace(hints=tuple(f"heard meanwhile: {_described(heard[topic])}" for topic in near))


class _Link:
    """The client of a source, in a thread of its own."""

    def __init__(
        self,
        name: str,
        broker: Broker,
        inbox: Inbox,
        topics: Mapping[str, int],
        session: float,
        status_topic: str | None,
    ) -> None:
        self._broker, self._inbox, self._session, self._status_topic = broker, inbox, session, status_topic
        self._topics = dict(topics)
        self._client: Client | None = None
        self._loop = asyncio.get_running_loop()
        self._open = asyncio.Event()
        self._changes: asyncio.Queue[tuple[Mapping[str, int], set[str]]] = asyncio.Queue()
        self._everything = EVERYTHING in topics
        self._background = Background(f"mqtt-{name}")

    async def opened(self) -> None:
        """Connect and subscribe. Raises SourceUnavailable and SourceConfigError."""
        self._background.start(self._attend)
        while not self._open.is_set():
            try:
                async with asyncio.timeout(_LOOK / 10):
                    await self._open.wait()
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
            self._loop.call_soon_threadsafe(self._open.set)
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
