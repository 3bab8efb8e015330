"""Live telemetry that devices publish on an MQTT broker."""

import asyncio
import logging
import secrets
from collections.abc import AsyncIterator, Collection, Sequence
from contextlib import asynccontextmanager

from adapters.channel import Binding
from adapters.errors import SourceUnavailable, said_of
from adapters.messages.decoding import numbers_in
from adapters.messages.inbox import Inbox, Incoming
from adapters.messages.subscribed import EVERYTHING, MOST_PLACES, SubscribedSource
from adapters.mqtt.client import OFFLINE, ONLINE, Client, Will, connected
from adapters.mqtt.config import MqttSourceConfig
from adapters.scanning import Scan, Scanned

HEADINGS = ("topic", "pointer", "number", "came")

_SHOWN = 5
_CLOSE_SECONDS = 1.0

_log = logging.getLogger(__name__)


class MqttSource(SubscribedSource):
    """Subscriptions of one client, which runs in a thread of its own."""

    _nothing = "nothing was retained; check topic, and that it is published"

    def __init__(self, name: str, table: MqttSourceConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, table.called(f"thermogate-{name}"), bindings)

    async def scan(self, wanted: Scan) -> Scanned:
        """The numbers in the newest message of every topic of others on which something comes within the time of
        `wanted`, or was retained, one a row. A number that is the whole payload has no pointer."""
        _, heard = await self._listen((), wanted.seconds)
        rows: list[tuple[str, ...]] = [HEADINGS]
        wordless: list[str] = []
        for topic in sorted(heard):
            numbers = numbers_in(heard[topic].payload or b"")
            came = "retained" if heard[topic].retained else "live"
            rows += [(topic, pointer or "-", f"{number:g}", came) for pointer, number in numbers]
            wordless += [] if numbers else [topic]
        remarks = (
            [] if heard else [f"nothing came within {wanted.seconds:g} s, and nothing was retained; listen longer"]
        )
        if wordless:
            more = ", ..." if len(wordless) > _SHOWN else ""
            remarks.append(f"topics without a number: {len(wordless)} ({', '.join(wordless[:_SHOWN])}{more})")
        if len(heard) >= MOST_PLACES:
            remarks.append(f"more than {MOST_PLACES} topics are published; the rest is not listed")
        return Scanned(rows, remarks)

    @asynccontextmanager
    async def _reached(self, inbox: Inbox, probed: Collection[str] | None = None) -> AsyncIterator[Client]:
        name, status, session, will = self._table.client_id, self._table.status_topic, self._table.session, None
        if probed is not None:
            # Under its own name it would take the place of the daemon.
            name, session = f"thermogate-probe-{secrets.token_hex(4)}", 0.0
        elif status and session:
            will = Will(status, OFFLINE)

        def came(incoming: Incoming) -> None:
            inbox.put(incoming.key if probed is None or incoming.key in probed else EVERYTHING, incoming)

        broker = self._table.model_copy(update={"client_id": name})
        with said_of(self.name):
            async with connected(broker, came, session, will) as self._link:
                if will is not None:
                    await self._link.publish(will.topic, ONLINE)
                if probed is not None:
                    await self._link.subscribe({EVERYTHING: 0, **dict.fromkeys(probed, 0)})
                try:
                    yield self._link
                finally:
                    if will is not None:
                        await _said_goodbye(self._link, will.topic)

    async def _subscribe(self, link: Client, inbox: Inbox, keys: Sequence[str]) -> None:
        """Each with its quality of service: the broker is to keep what says its own time, as a SenML pack may, while
        the connection is lost; a value without a time would be dated when it is back."""
        qos = dict.fromkeys(keys, self._table.qos or 0)
        if self._table.qos is None and "payload" in self._table.times:
            for key in keys:
                forms = [channel.form for channel in self._channels.at(key)]
                qos[key] = int(any(form.time is not None or form.format == "senml" for form in forms))
        await link.subscribe(qos)

    async def _unsubscribe(self, link: Client, keys: Sequence[str]) -> None:
        await link.unsubscribe(keys)

    def _connected(self, link: Client, seconds: float) -> bool:
        link.check()
        return True


async def _said_goodbye(client: Client, topic: str) -> None:
    """An orderly end leaves no will."""
    try:
        async with asyncio.timeout(_CLOSE_SECONDS / 2):
            await client.publish(topic, OFFLINE)
    except (SourceUnavailable, TimeoutError):
        _log.debug("%s could not be told that the source is offline", topic)
