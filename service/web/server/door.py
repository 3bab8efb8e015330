"""The door of the HTTP server: who is let in, and who is shown out again."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import ssl
from collections import Counter
from collections.abc import Callable
from http import HTTPStatus
from typing import Literal

from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.config import Config
from uvicorn.server import ServerState

from service.config.http import HttpConfig
from service.fields.values import is_loopback
from service.web.server.peers import peer_of, plain_address
from service.web.server.protocol import UNIX, Protocol
from service.web.server.refusal import RequestRefused, refusal
from service.web.server.turns import Turns

SPARE = 32
"""Connections beyond the limit that are still told so; more are closed at once."""

SWEEP_SECONDS = 1.0
RETRY_SECONDS = 5

_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_GONE = (errno.ECONNABORTED, errno.EPROTO)

_log = logging.getLogger(__name__)


class Door:
    """Accepts the connections of `listener`, counts them, and watches over them. `run` serves until it is cancelled.

    Connections are counted before the TLS handshake, so that those who never finish it count too.
    """

    def __init__(
        self,
        listener: socket.socket,
        config: HttpConfig,
        server: Config,
        state: ServerState,
        context: Callable[[], ssl.SSLContext | None],
    ) -> None:
        """`context` is asked for every connection."""
        self._listener = listener
        self._limits = config.limits
        self._proxies = frozenset(config.trusted_proxies) if config.behind_tls_proxy else frozenset()
        self._server = server
        self._state = state
        self._context = context
        self._turns = Turns()
        self._peers: Counter[str] = Counter()
        self._greetings: set[asyncio.Task[None]] = set()
        self.cut_off: Counter[str] = Counter()
        """Connections that were ended because of their client: too many, or too slow to ask or to read."""

    @property
    def connections(self) -> int:
        """How many connections there are, those in their handshake too."""
        return self._peers.total()

    @property
    def open_connections(self) -> tuple[Protocol, ...]:
        """The connections past their handshake."""
        return tuple(one for one in self._state.connections if isinstance(one, Protocol))

    async def run(self) -> None:
        """Accept connections until cancelled."""
        loop = asyncio.get_running_loop()
        sweeping = asyncio.create_task(self._sweep())
        try:
            while True:
                try:
                    connection, address = await loop.sock_accept(self._listener)
                except OSError as error:
                    if error.errno not in (*_EXHAUSTED, *_GONE):
                        raise
                    if error.errno in _EXHAUSTED:
                        _log.error("no connection can be accepted now (%s)", error.strerror)
                        await asyncio.sleep(SWEEP_SECONDS)
                    continue
                self._admit(connection, address)
        finally:
            sweeping.cancel()
            for greeting in self._greetings:
                greeting.cancel()
            await asyncio.gather(sweeping, *self._greetings, return_exceptions=True)

    async def close(self) -> None:
        """Drop the connections that there still are, with what waits for their clients."""
        for connection in self.open_connections:
            connection.transport.abort()
        while self.open_connections:
            await asyncio.sleep(0)

    def _admit(self, connection: socket.socket, address: tuple[str, int] | Literal[""]) -> None:
        connection.setblocking(False)
        # A UNIX socket has no addresses.
        host = plain_address(address[0]) if address else UNIX
        peer = peer_of({"type": "http", "client": (host, 0)})
        # On loopback, and behind a proxy, many clients share an address.
        shared = host == UNIX or is_loopback(host) or host in self._proxies
        beyond = self.connections - self._limits.connections
        if not shared:
            beyond = max(beyond, self._peers[peer] - self._limits.connections_per_client)
        if beyond >= 0:
            self.cut_off["too many"] += 1
        if beyond >= SPARE:
            connection.close()
            return
        self._peers[peer] += 1
        greeting = asyncio.create_task(self._greet(connection, peer, _busy if beyond >= 0 else None))
        self._greetings.add(greeting)
        greeting.add_done_callback(self._greetings.discard)

    async def _greet(self, connection: socket.socket, peer: str, app: ASGIApp | None) -> None:
        """Make the connection one of the server's, after the handshake if it is encrypted."""
        context, limits = self._context(), self._limits
        timeouts = {"ssl_handshake_timeout": limits.receive_timeout, "ssl_shutdown_timeout": limits.send_timeout}
        protocol = Protocol(
            self._server, self._state, limits, self._turns, self._relieve, lambda: self._leave(peer), app
        )
        try:
            await asyncio.get_running_loop().connect_accepted_socket(
                lambda: protocol, connection, ssl=context, **(timeouts if context else {})
            )
        except BaseException as error:
            connection.close()
            if not protocol.met:
                self._leave(peer)
            if not isinstance(error, OSError):
                raise

    def _leave(self, peer: str) -> None:
        self._peers[peer] -= 1
        if not self._peers[peer]:
            del self._peers[peer]

    async def _sweep(self) -> None:
        """Look after every connection for ever."""
        shortest = min(self._limits.receive_timeout, self._limits.send_timeout)
        while True:
            await asyncio.sleep(min(SWEEP_SECONDS, shortest / 4))
            now = asyncio.get_running_loop().time()
            for connection in self.open_connections:
                self.cut_off.update(filter(None, [connection.check(now)]))
            self._relieve()

    def _relieve(self) -> None:
        """Let go of the slowest readers while more waits to be sent than there is room for; one may always stay."""
        connections = [one for one in self.open_connections if not one.transport.is_closing()]
        waiting = sum(connection.unsent for connection in connections)
        for connection in sorted(connections, key=lambda one: one.stalled_since)[:-1]:
            if waiting <= self._limits.unsent:
                return
            waiting -= connection.unsent
            connection.transport.abort()
            self.cut_off["slow to read"] += 1


async def _busy(scope: Scope, receive: Receive, send: Send) -> None:
    """The application of connections beyond the limit."""
    sentence = "too many connections are open; close some, or try again later"
    refused = RequestRefused(
        HTTPStatus.SERVICE_UNAVAILABLE, [sentence], retry_after=RETRY_SECONDS, headers={"Connection": "close"}
    )
    await refusal(refused)(scope, receive, send)
