"""uvicorn inside the daemon's own event loop, behind a door of our own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections import Counter
from collections.abc import Iterable, Iterator

import uvicorn
from fastapi import FastAPI

from service.errors import ServiceError
from service.http_door import Door
from service.http_models import HttpConfig
from service.tls import ServerCertificate, server_certificate

SHUTDOWN_SECONDS = 1
FOLLOW_SECONDS = 10.0
"""How often a renewed certificate is looked for."""

BACKLOG = 256

SEND_BUFFER = 131_072
"""Bytes that the system takes for a client that does not read; left to itself it takes megabytes for each."""

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
        self._socket = _bound(config, setting)
        host, port = self._socket.getsockname()[:2]
        scheme = "http" if self.certificate is None else "https"
        self.url = f"{scheme}://[{host}]:{port}" if ":" in host else f"{scheme}://{host}:{port}"
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
                # A socket for IPv4 and IPv6 wraps the former into the latter.
                forwarded_allow_ips=[
                    *config.trusted_proxies,
                    *(f"::ffff:{one}" for one in config.trusted_proxies if "." in one),
                ],
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
            self._socket.close()
            await serving
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
        self._socket.close()

    async def stop(self, serving: asyncio.Task[None]) -> None:
        """Finish open requests, for a second at most, and close."""
        self._server.should_exit = True
        await serving

    async def _follow(self) -> None:
        """Notice a renewed certificate, for ever."""
        while True:
            if self.certificate is not None:
                self.certificate.follow()
            await asyncio.sleep(FOLLOW_SECONDS)


def _bound(config: HttpConfig, setting: str) -> socket.socket:
    """A socket on the configured address; ServiceError, naming the `setting` of the port, if that is impossible."""
    family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
    # With the protocol named, asyncio turns Nagle's algorithm off; an answer would otherwise wait 40 ms.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setblocking(False)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    # Connections that are accepted inherit it.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    try:
        listener.bind((config.host, config.port))
    except OSError as error:
        listener.close()
        raise ServiceError(
            f"http: {config.host}:{config.port} cannot be used ({error.strerror}); "
            f"choose another {setting}, or 0 for any free one"
        ) from error
    return listener


def _both_ways(addresses: Iterable[str]) -> list[str]:
    """`addresses`, those of IPv4 also as a socket for both wraps them into IPv6."""
    return [form for one in addresses for form in ((one, f"::ffff:{one}") if "." in one else (one,))]
