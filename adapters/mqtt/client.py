"""The MQTT client library behind one door: connections, with the library's errors as ours."""

import asyncio
import logging
import ssl
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any, NamedTuple

from adapters.cancelling import in_thread
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.mqtt.broker import BrokerConfig

OnMessage = Callable[[Incoming], None]

ONLINE, OFFLINE = b"online", b"offline"
"""What a topic says of us, the latter also as the last will."""
IN_FLIGHT = 100
"""Messages that wait for the broker's word at a time, at most."""

_TOPICS_AT_ONCE = 100
_DENIED = 128
_CLOSE_SECONDS = 1.0

_log = logging.getLogger(__name__)


class Will(NamedTuple):
    """What the broker publishes for us, retained, when the connection is lost."""

    topic: str
    payload: bytes


class Client:
    """A connection in a thread of the library, made inside the event loop that uses it. Raises SourceUnavailable."""

    def __init__(self, broker: BrokerConfig, on_message: OnMessage | None, session: float, will: Will | None) -> None:
        self._broker, self._session = broker, session
        self._loop = asyncio.get_running_loop()
        self._failure: SourceUnavailable | None = None
        self._reason: object = None
        self._ended = asyncio.Event()
        self._answers: dict[int | None, asyncio.Future[Any]] = {}
        """What the broker is waited for to say, by the number of the message; None: that it takes us."""
        self._library = library = _library(lambda error: self._tell(self._end, error))(broker, session)
        user, secret = broker.credentials()
        if user is not None:
            library.username_pw_set(user, secret)
        if (context := broker.context()) is not None:
            library.tls_set_context(context)
        if will is not None:
            library.will_set(will.topic, will.payload, qos=1, retain=True)
        library.connect_timeout = broker.timeout
        library.max_inflight_messages_set(IN_FLIGHT)
        library.on_connect = lambda client, data, flags, code, properties: self._tell(self._settle, None, code)
        library.on_disconnect = lambda client, data, flags, code, properties: self._tell(self._end, code)
        library.on_publish = lambda client, data, mid, code, properties: self._tell(self._settle, mid, code)
        library.on_subscribe = lambda client, data, mid, codes, properties: self._tell(self._settle, mid, codes)
        library.on_unsubscribe = library.on_subscribe

        def came(client: object, data: object, message: Any) -> None:
            # A topic that is no text is nobody's.
            with suppress(UnicodeDecodeError):
                if on_message is not None:
                    on_message(_incoming(message))

        library.on_message = came

    async def open(self) -> None:
        """Connect. Raises SourceUnavailable."""
        broker, settings = self._broker, {}
        if broker.version == "5":
            from paho.mqtt.packettypes import PacketTypes
            from paho.mqtt.properties import Properties

            properties = Properties(PacketTypes.CONNECT)
            properties.SessionExpiryInterval = int(self._session)
            settings = {"clean_start": not self._session, "properties": properties}
        self._answers[None] = self._loop.create_future()

        def connect() -> None:
            self._library.connect(broker.host or "", broker.tcp_port, max(1, int(broker.keepalive)), **settings)
            self._library.loop_start()

        try:
            # The thread that connects cannot be called off: what it opens for nobody is closed.
            await in_thread(connect, lambda _: self._shut())
            code = await self._answer(None)
        except (SourceUnavailable, OSError, ValueError) as error:
            reason = self._reason or error.__cause__ or error
            raise SourceUnavailable(_silent(broker, reason)) from error
        finally:
            self._answers.pop(None, None)
        if code.is_failure:
            raise SourceUnavailable(
                f"{broker.place} refuses this client ({code}); check user and password, client_id, and whether the "
                f"broker speaks MQTT {broker.version}"
            )

    async def subscribe(self, topics: Mapping[str, int]) -> None:
        """Subscribe to `topics`, each with its quality of service; one that the broker refuses is said in the log."""
        listed = list(topics.items())
        for first in range(0, len(listed), _TOPICS_AT_ONCE):
            asked = listed[first : first + _TOPICS_AT_ONCE]
            for (topic, _), granted in zip(asked, await self._sent(self._library.subscribe(asked)), strict=False):
                if granted.value >= _DENIED:
                    say = "%s refuses the topic %s (%s); check the access rules of the broker"
                    _log.warning(say, self._broker.place, topic, granted)

    async def unsubscribe(self, topics: Iterable[str]) -> None:
        if listed := list(topics):
            await self._sent(self._library.unsubscribe(listed))

    async def publish(self, topic: str, payload: bytes) -> None:
        """Publish, retained and at least once; returns when the broker has it."""
        await self._sent(self._library.publish(topic, payload, qos=1, retain=True))

    def check(self) -> None:
        """Raise why the connection is lost, if it is."""
        if self._failure is not None:
            raise self._failure

    async def lost(self) -> None:
        """Wait until the connection is lost, and raise SourceUnavailable."""
        await self._ended.wait()
        self.check()

    async def close(self) -> None:
        """Disconnect; gives up after a second rather than hang."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_CLOSE_SECONDS):
                await in_thread(self._shut)

    async def _sent(self, sent: Any) -> Any:
        """What the broker answers to what was `sent`: the library's code for it, and its number."""
        code, mid = sent
        self.check()
        if code:
            raise SourceUnavailable(self._lost("it takes nothing"))
        # What the thread is told comes here in a later turn of the loop.
        self._answers[mid] = self._loop.create_future()
        return await self._answer(mid)

    async def _answer(self, mid: int | None) -> Any:
        try:
            async with asyncio.timeout(self._broker.timeout):
                return await self._answers[mid]
        except TimeoutError:
            self._reason = self._reason or f"no answer within {self._broker.timeout:g} s"
            raise SourceUnavailable(self._lost(self._reason)) from None
        finally:
            self._answers.pop(mid, None)

    def _tell(self, action: Callable[..., None], *arguments: object) -> None:
        # Where the loop is gone, so is whoever wants to know.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(action, *arguments)

    def _settle(self, mid: int | None, said: object) -> None:
        answer = self._answers.get(mid)
        if answer is not None and not answer.done():
            answer.set_result(said)

    def _end(self, reason: object) -> None:
        if self._failure is not None:
            return
        self._reason, self._failure = reason, SourceUnavailable(self._lost(reason))
        self._ended.set()
        for answer in self._answers.values():
            if not answer.done():
                answer.set_exception(self._failure)

    def _lost(self, reason: object) -> str:
        return (
            f"the connection to {self._broker.place} is lost ({reason}); check that the broker is on, and that no "
            f'other client has the client_id "{self._broker.client_id}"'
        )

    def _shut(self) -> None:
        self._library.disconnect()
        self._library.loop_stop()


@asynccontextmanager
async def connected(
    broker: BrokerConfig, on_message: OnMessage | None = None, session: float = 0.0, will: Will | None = None
) -> AsyncIterator[Client]:
    """A connection to `broker` for as long as the context lasts. `on_message` is called in a thread of the library, and
    must not wait. The broker keeps subscriptions and their messages for `session` s after the connection is lost.
    Raises SourceUnavailable and SourceConfigError."""
    for problem in broker.problems():
        raise SourceConfigError(problem)
    client = Client(broker, on_message, session, will)
    try:
        await client.open()
        yield client
    finally:
        await client.close()


def _library(ended: Callable[[object], None]) -> Any:
    """What makes a client of the library, whose thread calls `ended` when it ends, whatever it stumbled over."""
    import paho.mqtt.client as paho

    class Library(paho.Client):
        def __init__(self, broker: BrokerConfig, session: float) -> None:
            new = broker.version == "5"
            super().__init__(
                paho.CallbackAPIVersion.VERSION2,
                broker.client_id or "",
                clean_session=None if new else not session,
                protocol=paho.MQTTv5 if new else paho.MQTTv311,
                reconnect_on_failure=False,
            )

        def loop_forever(self, *arguments: Any, **settings: Any) -> Any:
            reason: object = "it has ended"
            try:
                return super().loop_forever(*arguments, **settings)
            except Exception as error:
                reason = error
                return paho.MQTT_ERR_UNKNOWN
            finally:
                ended(reason)

    return Library


def _incoming(message: Any) -> Incoming:
    payload = message.payload or b""
    size = len(payload)
    fits = payload if size <= LONGEST_PAYLOAD else None
    return Incoming(str(message.topic), fits, size, None, time.time(), bool(message.retain))


def _silent(broker: BrokerConfig, error: object) -> str:
    said = str(error).partition("] ")[2] or str(error)
    if isinstance(error, ssl.SSLError):
        return (
            f"{broker.place} does not agree on TLS ({said}); check tls.ca, the broker's certificate and the name in "
            "it, and that the port speaks TLS"
        )
    return f"no MQTT broker answers at {broker.place} ({said}); check that it is on, host, port and tls"
