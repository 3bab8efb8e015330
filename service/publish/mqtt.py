"""What every zone announces on a broker, for Home Assistant too: topics
`thermogate/<site>/<zone>/{forecast,volatility,...}`, all retained, and `thermogate/<site>/availability`, which the
broker turns to "offline" when the connection is lost. Only the newest message of each topic waits for the broker."""

import asyncio
import logging
import threading
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from adapters.background import Background
from adapters.errors import SourceError
from adapters.fields.addresses import web_address
from adapters.fields.values import Flag, choice
from adapters.fields.words import shown
from adapters.mqtt.broker import BrokerConfig, Topic
from adapters.mqtt.client import IN_FLIGHT, OFFLINE, ONLINE, Client, Will, connected
from service.pauses import GrowingPause, within
from service.publish.home_assistant import discovery
from service.publish.language import LANGUAGES
from service.publish.sinks import Announcement, Sink, SinkKind
from service.records.measures import Measure, single

CLEARED = b""
"""An empty retained message makes the broker forget the topic."""
FIRST_PAUSE = 1.0
LONGEST_PAUSE = 30.0

_CLOSE_SECONDS = 2.0

_log = logging.getLogger(__name__)


class MqttConfig(BrokerConfig):
    """[mqtt]: the broker on which the daemon publishes."""

    home_assistant: Flag = Field(default=False, description="every zone is a device in Home Assistant")
    discovery_prefix: Topic = Field(default="homeassistant", description="first level of its discovery topics")
    page: Annotated[str, BeforeValidator(web_address("http://192.168.1.20:8080"))] | None = Field(
        default=None,
        description='where browsers find the page, such as `"http://192.168.1.20:8080"`: each device links to its room',
    )
    language: Annotated[Literal["en", "de"], BeforeValidator(choice(*LANGUAGES))] = Field(
        default="en", description="of reasons, findings and other sentences, and of names in Home Assistant"
    )

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        fields = type(self).model_fields.items()
        given = [name for name, field in fields if getattr(self, name) != field.default]
        if self.host is None and given:
            raise ValueError(f'{shown(given[0])} needs host, the broker to publish on, such as host = "192.168.1.10"')
        return self

    def problems(self) -> Iterator[str]:
        """As of BrokerConfig, where there is a broker."""
        return iter(()) if self.host is None else super().problems()


class Publisher(Sink):
    """A client of a broker, in a thread of its own. Methods may be called from any thread."""

    def __init__(
        self,
        broker: BrokerConfig,
        site: str,
        discovery_prefix: str | None = None,
        page: str | None = None,
        language: str = LANGUAGES[0],
    ) -> None:
        """`discovery_prefix`: what the topics of Home Assistant's discovery begin with; None: it is told nothing.
        `page`: the address of the page for people. `language`: of sentences and names."""
        self._language = language
        self._broker, self._site, self._prefix, self._page = broker, site, discovery_prefix, page
        self._available = f"thermogate/{site}/availability"
        self._background = Background("mqtt-publisher")
        self._lock = threading.Lock()
        self._last: dict[str, bytes] = {}
        """What the broker is to retain, by topic."""
        self._pending: set[str] = set()
        """The topics whose newest message the broker does not have yet."""
        self._described: dict[str, set[tuple[str, ...]]] = {}
        """What Home Assistant has been told of, for every zone that is published."""
        self._overtaken = 0
        self._connected = False
        self._news, self._closing = asyncio.Event(), asyncio.Event()

    def open(self) -> Self:
        """Begin to connect; a broker that is away is waited for."""
        self._background.start(self._attend)
        return self

    def add(self, zone: str) -> None:
        with self._lock:
            self._described[zone] = set()

    def remove(self, zone: str) -> None:
        """Publish `zone` no longer, and let the broker forget it; without effect if it is not published."""
        with self._lock:
            if self._described.pop(zone, None) is None:
                return
            mine = (f"{self._base(zone)}/", f"/thermogate_{self._site}_{zone}/")
            left = [topic for topic in self._last if topic.startswith(mine[0]) or mine[1] in topic]
            self._keep(dict.fromkeys(left, CLEARED))

    def publish(self, announcement: Announcement) -> None:
        """Leave what is announced for the broker, in the place of older messages, unless nothing is new."""
        zone, base = announcement.zone, self._base(announcement.zone)
        messages = {f"{base}/{topic}": document for topic, document in announcement.lasting(self._language).items()}
        with self._lock:
            told = self._described.get(zone)
            if told is None:
                # A reload has removed the zone under its last step.
                return
            ahead = announcement.reports.ahead
            heating = ("heating",) if ahead is not None and ahead.heating is not None else ()
            entities = (*announcement.topics, *heating)
            if self._prefix is not None and entities not in told:
                told.add(entities)
                messages |= discovery(
                    self._prefix, self._site, base, self._available, announcement, self._page, self._language
                )
            self._keep({topic: payload for topic, payload in messages.items() if self._last.get(topic) != payload})

    def measures(self) -> list[Measure]:
        """Whether the broker is there, and what it was too slow for."""
        return [
            Measure.called("thermogate_mqtt_connected", lambda: single(float(self._connected))),
            Measure.called("thermogate_mqtt_messages_overtaken", lambda: single(float(self._overtaken))),
        ]

    def close(self) -> None:
        """Send what is pending, say that we are offline and disconnect, within seconds; safe to call twice."""
        self._background.call(self._closing.set)
        if not self._background.wait(_CLOSE_SECONDS) and not self._background.stop(_CLOSE_SECONDS):
            _log.warning("the MQTT publisher did not end within %g s; left to the end of the process", _CLOSE_SECONDS)

    def _base(self, zone: str) -> str:
        return f"thermogate/{self._site}/{zone}"

    def _keep(self, messages: dict[str, bytes]) -> None:
        """With the lock: these are what the broker is to retain."""
        if messages:
            self._overtaken += len(self._pending & messages.keys())
            self._last |= messages
            self._pending |= messages.keys()
            self._background.call(self._news.set)

    async def _attend(self) -> None:
        """Be connected, for as long as it takes to be closed."""
        pause = GrowingPause(FIRST_PAUSE, LONGEST_PAUSE)
        while not self._closing.is_set():
            try:
                async with connected(self._broker, will=Will(self._available, OFFLINE)) as client:
                    pause.reset()
                    await self._serve(client)
            except SourceError as error:
                reason = str(error)
            except Exception as error:
                # Whatever else goes wrong there must not end it for good.
                reason = f"the publisher failed: {error!r}"
                _log.debug("[mqtt]: %s", reason, exc_info=error)
            else:
                continue
            _log.error("[mqtt]: %s; trying again in %.0f s", reason, pause.seconds)
            await within(self._closing, pause.seconds)
            pause.grow()

    async def _serve(self, client: Client) -> None:
        """Publish on `client` until it is lost or we are closed."""
        with self._lock:
            # A broker that was away may have forgotten everything.
            self._pending |= self._last.keys()
        self._news.set()
        await client.publish(self._available, ONLINE)
        _log.info("[mqtt]: connected (%s)", self._broker.place)
        self._connected = True
        tasks = [asyncio.create_task(work) for work in (client.lost(), self._send(client), self._closing.wait())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
            await self._send_pending(client)
            await client.publish(self._available, OFFLINE)
        finally:
            self._connected = False
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _send(self, client: Client) -> None:
        while True:
            await self._news.wait()
            self._news.clear()
            await self._send_pending(client)

    async def _send_pending(self, client: Client) -> None:
        room = asyncio.Semaphore(IN_FLIGHT)

        async def send(topic: str) -> None:
            async with room:
                with self._lock:
                    self._pending.discard(topic)
                    payload = self._last.get(topic, CLEARED)
                await client.publish(topic, payload)
                with self._lock:
                    if payload == CLEARED == self._last.get(topic):
                        del self._last[topic]

        with self._lock:
            pending = sorted(self._pending)
        await asyncio.gather(*map(send, pending))


def _open(table: MqttConfig, site: str) -> Publisher | None:
    if table.host is None:
        return None
    broker = table.called(f"thermogate-{site}")
    prefix = table.discovery_prefix if table.home_assistant else None
    return Publisher(broker, site, prefix, table.page, table.language).open()


KIND = SinkKind("mqtt", MqttConfig, _open)
