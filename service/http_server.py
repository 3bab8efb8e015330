"""uvicorn inside the daemon's own event loop, started and stopped by us."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Iterator

import uvicorn
from fastapi import FastAPI

from service.config_models import HttpConfig
from service.errors import ServiceError

SHUTDOWN_SECONDS = 1

SEND_BUFFER = 131_072
"""Bytes that the system takes for a client that does not read; left to itself it takes megabytes for each."""

UNREAD_SECONDS = 30
"""For so long a client may take nothing of what it is sent; then the system cuts the connection, and what waited for
it is freed."""

_log = logging.getLogger(__name__)


class _QuietServer(uvicorn.Server):
    """uvicorn without its signal handlers: SIGTERM and SIGINT are the daemon's."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class HttpServer:
    """REST on the configured address. `run` serves until `stop`."""

    def __init__(self, app: FastAPI, config: HttpConfig, setting: str = "http.port") -> None:
        """Binds the address; ServiceError, naming the `setting` of the port, if that is impossible."""
        family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
        # With the protocol named, asyncio turns Nagle's algorithm off; an answer would otherwise wait 40 ms.
        self._socket = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # Connections that are accepted inherit both.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 1000 * UNREAD_SECONDS)
        try:
            self._socket.bind((config.host, config.port))
        except OSError as error:
            self._socket.close()
            raise ServiceError(
                f"http: {config.host}:{config.port} cannot be used ({error.strerror}); "
                f"choose another {setting}, or 0 for any free one"
            ) from error
        host, port = self._socket.getsockname()[:2]
        self.url = f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
        self._server = _QuietServer(
            uvicorn.Config(
                app,
                log_config=None,
                access_log=False,
                lifespan="off",
                timeout_graceful_shutdown=SHUTDOWN_SECONDS,
                server_header=False,
            )
        )

    async def run(self) -> None:
        """Serve until `stop`."""
        await self._server.serve(sockets=[self._socket])

    async def started(self, serving: asyncio.Task[None]) -> None:
        """Wait until requests are answered; `serving` is the task of `run`, whose failure is raised."""
        while not self._server.started:
            if serving.done():
                serving.result()
                raise ServiceError(f"http: the server on {self.url} ended at once")
            await asyncio.sleep(0.01)
        _log.info("serving on %s", self.url)

    def close(self) -> None:
        """Give the address back, if `run` never took it over; safe after `stop`."""
        self._socket.close()

    async def stop(self, serving: asyncio.Task[None]) -> None:
        """Finish open requests, for a second at most, and close."""
        self._server.should_exit = True
        await serving
