"""The MQTT client library behind one door: connections, with the library's errors as ours."""

from __future__ import annotations

import asyncio
import logging
import ssl
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any, NamedTuple, TypeVar

from adapters.cancelling import cancellable
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.mqtt.broker import BrokerConfig

OnMessage = Callable[[Incoming], None]
Result = TypeVar("Result")

IN_FLIGHT = 100
"""Messages that wait for the broker's word at a time, at most."""

_TOPICS_AT_ONCE = 100
_DENIED = 128

_log = logging.getLogger(__name__)


class Will(NamedTuple):
    """What the broker publishes for us, retained, when the connection is lost."""

    topic: str
    payload: bytes


class Client:
    """An open connection. Every method raises SourceUnavailable where it is lost."""

    def __init__(self, client: Any, broker: BrokerConfig) -> None:
        self._client, self._broker = client, broker

    async def subscribe(self, topics: Mapping[str, int]) -> None:
        """Subscribe to `topics`, each with its quality of service; one that the broker refuses is said in the log."""
        listed = list(topics.items())
        for first in range(0, len(listed), _TOPICS_AT_ONCE):
            asked = listed[first : first + _TOPICS_AT_ONCE]
            for (topic, _), granted in zip(asked, await self._translated(self._client.subscribe(asked)), strict=False):
                code = getattr(granted, "value", granted)
                if code >= _DENIED:
                    _log.warning(
                        "%s refuses the topic %s (%s); check the access rules of the broker",
                        self._broker.place,
                        topic,
                        granted,
                    )

    async def unsubscribe(self, topics: Iterable[str]) -> None:
        """Give the subscriptions to `topics` up."""
        if listed := list(topics):
            await self._translated(self._client.unsubscribe(listed))

    async def publish(self, topic: str, payload: bytes) -> None:
        """Publish, retained and at least once; returns when the broker has it."""
        await self._translated(self._client.publish(topic, payload, qos=1, retain=True))

    async def lost(self) -> None:
        """Wait until the connection is lost, and raise SourceUnavailable."""

        async def listen() -> None:
            async for _ in self._client.messages:
                raise AssertionError("messages go another way")

        await self._translated(listen())

    async def _translated(self, work: Awaitable[Result]) -> Result:
        import aiomqtt

        try:
            return await cancellable(work)
        except aiomqtt.MqttError as error:
            raise SourceUnavailable(_lost(self._broker, error)) from error


@asynccontextmanager
async def connected(
    broker: BrokerConfig, on_message: OnMessage | None = None, session: float = 0.0, will: Will | None = None
) -> AsyncIterator[Client]:
    """A connection to `broker` for as long as the context lasts.

    `on_message` is called for every message, in the event loop of the caller, and must not wait. The broker keeps the
    subscriptions, and what comes on them meanwhile, for `session` s after the connection is lost. Raises
    SourceUnavailable and SourceConfigError.
    """
    for problem in broker.problems():
        raise SourceConfigError(problem)
    import aiomqtt
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties

    user, secret = broker.credentials()
    settings: dict[str, Any] = {}
    if broker.version == "5":
        properties = Properties(PacketTypes.CONNECT)
        properties.SessionExpiryInterval = int(session)
        settings = {"clean_start": not session, "properties": properties}
    else:
        settings = {"clean_session": not session}
    client = aiomqtt.Client(
        broker.host or "",
        broker.tcp_port,
        username=user,
        password=secret,
        identifier=broker.client_id,
        protocol=aiomqtt.ProtocolVersion.V5 if broker.version == "5" else aiomqtt.ProtocolVersion.V311,
        will=None if will is None else aiomqtt.Will(will.topic, will.payload, qos=1, retain=True),
        timeout=broker.timeout,
        keepalive=max(1, int(broker.keepalive)),
        queue_type=_passing_on(on_message),
        max_inflight_messages=IN_FLIGHT,
        tls_context=broker.context(),
        **settings,
    )
    # Its warning about them is for those who wait for each message in turn.
    client.pending_calls_threshold = 2 * IN_FLIGHT
    connecting = asyncio.create_task(client.__aenter__())
    try:
        await asyncio.shield(connecting)
    except (aiomqtt.MqttError, OSError, ValueError) as error:
        _shut(client)
        raise SourceUnavailable(_refused(broker, error)) from error
    except asyncio.CancelledError:
        # The thread that connects cannot be called off, and nobody would close the socket that it opens.
        await asyncio.gather(connecting, return_exceptions=True)
        _shut(client)
        raise
    try:
        yield Client(client, broker)
    finally:
        # Whoever leaves because the connection is lost knows that already.
        with suppress(aiomqtt.MqttError, OSError):
            await client.__aexit__(None, None, None)
        _shut(client)


def _passing_on(on_message: OnMessage | None) -> Any:
    """A queue that keeps nothing: what is put there goes on at once, which costs a flood no task for each message."""

    class PassingOn(asyncio.Queue[Any]):
        def put_nowait(self, message: Any) -> None:
            if on_message is not None:
                on_message(_incoming(message))

    return PassingOn


def _incoming(message: Any) -> Incoming:
    payload = message.payload or b""
    size = len(payload)
    fits = payload if size <= LONGEST_PAYLOAD else None
    return Incoming(str(message.topic), fits, size, None, time.time(), bool(message.retain))


def _code(error: Exception) -> int | None:
    code = getattr(error, "rc", None)
    value = getattr(code, "value", code)
    return value if isinstance(value, int) else None


def _said(error: Exception) -> str:
    """What the library says, without its numbers."""
    code = getattr(error, "rc", None)
    if code is not None and not isinstance(code, int):
        return str(code)
    return str(error).partition("] ")[2] or str(error)


def _refused(broker: BrokerConfig, error: Exception) -> str:
    """Why there is no connection, and the remedy."""
    if isinstance(error, ssl.SSLError) or isinstance(error.__context__, ssl.SSLError):
        return (
            f"{broker.place} does not agree on TLS ({_said(error)}); check tls.ca, the broker's certificate and the "
            "name in it, and that the port speaks TLS"
        )
    if _code(error) is not None:
        return (
            f"{broker.place} refuses this client ({_said(error)}); check user and password, client_id, and whether the "
            f"broker speaks MQTT {broker.version}"
        )
    return f"no MQTT broker answers at {broker.place} ({_said(error)}); check that it is on, host, port and tls"


def _lost(broker: BrokerConfig, error: Exception) -> str:
    cause = error.__cause__ if isinstance(error.__cause__, Exception) else error
    return (
        f"the connection to {broker.place} is lost ({_said(cause)}); check that the broker is on, and that no other "
        f'client has the client_id "{broker.client_id}"'
    )


def _shut(client: Any) -> None:
    """Close the socket, which the library leaves open where a connection is refused or lost, in the loop too."""
    socket = client._client.socket()
    if socket is not None and socket.fileno() >= 0:
        loop = asyncio.get_running_loop()
        loop.remove_reader(socket)
        loop.remove_writer(socket)
        socket.close()
