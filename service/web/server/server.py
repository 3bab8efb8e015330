"""uvicorn inside the daemon's own event loop, with a count of connections in front."""

import asyncio
import contextlib
import errno
import logging
import socket
from asyncio.sslproto import SSLProtocol
from collections import Counter
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Literal

import uvicorn
from fastapi import FastAPI
from starlette.types import ASGIApp, Receive, Scope, Send

from adapters.fields.values import is_loopback
from service.config.http import HttpConfig
from service.errors import ServiceError
from service.web.server.connection import READ_BYTES, UNIX, Connection, Passes
from service.web.server.listener import listener
from service.web.server.peers import peer_of, plain_address
from service.web.server.refusal import CLOSE, RequestRefused
from service.web.server.tls import ServerCertificate, server_certificate

SPARE = 32
"""Connections beyond the limit that are still told so; more are closed at once."""
SHUTDOWN_SECONDS = 1
RETRY_SECONDS = 5
SWEEP_SECONDS = 1.0
BACKLOG = 256

_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_GONE = (errno.ECONNABORTED, errno.EPROTO)

_log = logging.getLogger(__name__)


class _Server(uvicorn.Server):
    """uvicorn without its signal handlers, which are the daemon's, and without listeners: connections are counted
    before their handshake, and each has the certificate of the moment."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        self.servers = []
        self.started = True


class HttpServer:
    """REST on the configured address. `run` serves until `stop`."""

    certificate: ServerCertificate | None

    def __init__(self, app: FastAPI, config: HttpConfig, setting: str = "http.port") -> None:
        """Binds the address and loads the certificate; ServiceError, which calls the port `setting`."""
        self.certificate = server_certificate(config)
        if self.certificate is not None:
            # Of each connection, from its handshake on; left to itself, asyncio takes 256 kB.
            SSLProtocol.max_size = READ_BYTES
        self._socket = listener(config, setting)
        self.url = _url(self._socket, "http" if self.certificate is None else "https")
        self._limits = config.limits
        self._proxies = frozenset(config.trusted_proxies) if config.behind_tls_proxy else frozenset()
        self._passes = Passes()
        self._peers: Counter[str] = Counter()
        self._greetings: set[asyncio.Task[None]] = set()
        self.cut_off: Counter[str] = Counter()
        """Connections that were ended because of their client: too many, or too slow to ask or to read."""
        self._server = _Server(
            uvicorn.Config(
                app,
                http="h11",
                ws="none",
                log_config=None,
                access_log=False,
                lifespan="off",
                timeout_graceful_shutdown=SHUTDOWN_SECONDS,
                timeout_keep_alive=config.limits.idle_timeout,  # type: ignore[arg-type]
                server_header=False,
                proxy_headers=config.behind_tls_proxy,
                forwarded_allow_ips=_as_seen(config),
            )
        )
        self._server.config.load()

    @property
    def connections(self) -> int:
        """How many connections there are, those in their handshake too."""
        return self._peers.total()

    @property
    def open_connections(self) -> tuple[Connection, ...]:
        """The connections past their handshake."""
        return tuple(one for one in self._server.server_state.connections if isinstance(one, Connection))

    async def run(self) -> None:
        """Serve until `stop`."""
        self._socket.listen(BACKLOG)
        watching = [asyncio.create_task(work) for work in (self._accept(), self._sweep())]
        serving = asyncio.create_task(self._server.serve())
        try:
            await asyncio.wait([*watching, serving], return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (*watching, *self._greetings):
                task.cancel()
            results = await asyncio.gather(*watching, *self._greetings, return_exceptions=True)
            self._server.should_exit = True
            self.close()
            await serving
            for connection in self.open_connections:
                connection.transport.abort()
            while self.open_connections:
                await asyncio.sleep(0)
        for result in results:
            if isinstance(result, Exception):
                raise result

    async def started(self, serving: asyncio.Task[None]) -> None:
        """Wait until requests are answered; `serving` is the task of `run`, whose failure is raised."""
        while not self._server.started:
            if serving.done():
                serving.result()
                raise ServiceError(f"http: the server on {self.url} ended at once")
            await asyncio.sleep(0.01)
        _log.info("serving on %s", self.url)

    def reload(self) -> None:
        """Serve the certificate that is in the files now, to new connections; CertificateError changes nothing."""
        if self.certificate is not None:
            self.certificate.reload()

    def close(self) -> None:
        """Give the address back, if `run` never took it over; safe after `stop`."""
        if self._socket.family == socket.AF_UNIX and self._socket.fileno() >= 0:
            Path(self._socket.getsockname()).unlink(missing_ok=True)
        self._socket.close()

    async def stop(self, serving: asyncio.Task[None]) -> None:
        """Finish open requests, for a second at most, and close; what a client has not taken by then is dropped."""
        self._server.should_exit = True
        await serving

    async def _accept(self) -> None:
        """Accept connections for ever."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, address = await loop.sock_accept(self._socket)
            except OSError as error:
                if error.errno not in (*_EXHAUSTED, *_GONE):
                    raise
                if error.errno in _EXHAUSTED:
                    _log.error("no connection can be accepted now (%s)", error.strerror)
                    await asyncio.sleep(SWEEP_SECONDS)
                continue
            self._admit(connection, address)

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
        limits, server = self._limits, (self._server.config, self._server.server_state)
        protocol = Connection(server, limits, self._passes, self._relieve, lambda: self._leave(peer), app)
        encryption: dict[str, object] = {}
        if self.certificate is not None:
            encryption = {
                "ssl": self.certificate.context,
                "ssl_handshake_timeout": limits.receive_timeout,
                "ssl_shutdown_timeout": limits.send_timeout,
            }
        try:
            loop = asyncio.get_running_loop()
            await loop.connect_accepted_socket(lambda: protocol, connection, **encryption)  # type: ignore[arg-type]
        except BaseException as error:
            connection.close()
            if protocol.transport is None:
                # It has not come about, and is not lost either.
                self._leave(peer)
            if not isinstance(error, OSError):
                raise
            # asyncio raises it in a frame that holds it, so that both would keep the connection and its buffers.
            error.__traceback__ = None

    def _leave(self, peer: str) -> None:
        self._peers[peer] -= 1
        if not self._peers[peer]:
            del self._peers[peer]

    async def _sweep(self) -> None:
        """Look after every connection, and for a renewed certificate, for ever."""
        shortest = min(self._limits.receive_timeout, self._limits.send_timeout)
        while True:
            await asyncio.sleep(min(SWEEP_SECONDS, shortest / 4))
            now = asyncio.get_running_loop().time()
            for connection in self.open_connections:
                self.cut_off.update(filter(None, [connection.check(now)]))
            self._relieve()
            if self.certificate is not None:
                self.certificate.follow()

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
    refused = RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], RETRY_SECONDS, CLOSE)
    await refused.answer(scope, receive, send)


def _url(listening: socket.socket, scheme: str) -> str:
    if listening.family == socket.AF_UNIX:
        return f"unix:{listening.getsockname()}"
    host, port = listening.getsockname()[:2]
    return f"{scheme}://[{host}]:{port}" if ":" in host else f"{scheme}://{host}:{port}"


def _as_seen(config: HttpConfig) -> list[str]:
    """Trusted proxies as the server sees them: a socket for IPv4 and IPv6 wraps the former into the latter."""
    if config.socket is not None:
        return [UNIX]
    proxies = config.trusted_proxies
    return [*proxies, *(f"::ffff:{address}" for address in proxies if "." in address)]
