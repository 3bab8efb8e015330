"""uvicorn inside the daemon's own event loop, behind a door of our own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import uvicorn
from fastapi import FastAPI

from service.config.http import HttpConfig
from service.errors import ServiceError
from service.web.server.door import Door
from service.web.server.listener import listener
from service.web.server.protocol import UNIX, Protocol
from service.web.server.tls import ServerCertificate, server_certificate

SHUTDOWN_SECONDS = 1
FOLLOW_SECONDS = 10.0
"""How often a renewed certificate is looked for."""

BACKLOG = 256

_log = logging.getLogger(__name__)


class _Server(uvicorn.Server):
    """uvicorn without its signal handlers, which are the daemon's, and without listeners, which are the door's."""

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
        """Binds the address and loads the certificate; ServiceError if either is impossible.

        `setting` is what the operator knows the port by.
        """
        self.certificate = server_certificate(config)
        self._socket = listener(config, setting)
        self.url = _url(self._socket, "http" if self.certificate is None else "https")
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
                h11_max_incomplete_event_size=config.limits.headers,
                server_header=False,
                proxy_headers=config.behind_tls_proxy,
                forwarded_allow_ips=_as_seen(config),
            )
        )
        self._server.config.load()
        self._door = Door(
            self._socket,
            config,
            self._server.config,
            self._server.server_state,
            lambda: None if self.certificate is None else self.certificate.context,
        )

    @property
    def connections(self) -> int:
        """How many connections there are, those in their handshake too."""
        return self._door.connections

    @property
    def open_connections(self) -> tuple[Protocol, ...]:
        """The connections past their handshake."""
        return self._door.open_connections

    @property
    def cut_off(self) -> Counter[str]:
        """How many connections were ended because of their client, by reason."""
        return self._door.cut_off

    async def run(self) -> None:
        """Serve until `stop`."""
        self._socket.listen(BACKLOG)
        accepting = asyncio.create_task(self._door.run())
        following = asyncio.create_task(self._follow())
        serving = asyncio.create_task(self._server.serve())
        try:
            await asyncio.wait([accepting, following, serving], return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (accepting, following):
                task.cancel()
            results = await asyncio.gather(accepting, following, return_exceptions=True)
            self._server.should_exit = True
            self.close()
            await serving
            await self._door.close()
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

    async def _follow(self) -> None:
        """Notice a renewed certificate, for ever."""
        while True:
            if self.certificate is not None:
                self.certificate.follow()
            await asyncio.sleep(FOLLOW_SECONDS)


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
