"""REST and its page at the address of [http], for the daemon's zones or those of a whole fleet."""

import asyncio
from collections.abc import Mapping
from importlib.metadata import version

from fastapi import FastAPI
from prometheus_client import CollectorRegistry

from service.config.site import Config
from service.publish.events import Streams
from service.publish.sinks import Sink
from service.records.view import ZoneView
from service.web.app import create_app
from service.web.keys import KeyRing
from service.web.server.server import HttpServer
from service.web.site import Backend, Problems, Reload, Take


class Serving:
    """The HTTP server of `config`; what `sinks` are told goes to the clients that listen."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._streams = Streams()
        self.sinks: tuple[Sink, ...] = (self._streams,)
        self.server: HttpServer | None = None
        self.task: asyncio.Task[None] | None = None
        """Ends with the server."""

    def open(
        self,
        zones: Mapping[str, ZoneView],
        registry: CollectorRegistry,
        *,
        problems: Problems,
        reload: Reload,
        take: Take,
    ) -> tuple[HttpServer, FastAPI]:
        """Take the address, to serve `zones` as `service.web.app.create_app` says. Raises ServiceError."""
        config = self._config
        app = create_app(
            config.site.id,
            zones,
            registry,
            keys=KeyRing(config.keys_file, required=config.http.exposed),
            http=config.http,
            backend=Backend(version("thermogate"), config.site.time_zone, problems, reload, take, self._streams),
        )
        self.server = HttpServer(app, config.http)
        return self.server, app

    async def start(self) -> asyncio.Task[None]:
        """Serve; the task that ends with the server. Raises ServiceError where it ends at once."""
        assert self.server is not None, "the address is taken first"
        self.task = asyncio.create_task(self.server.run())
        await self.server.started(self.task)
        return self.task

    def reload(self) -> None:
        """Serve the certificate that is in the files now. Raises CertificateError, and then nothing has changed."""
        if self.server is not None:
            self.server.reload()

    async def stop(self) -> None:
        """Finish open requests and serve nobody any more; safe without a start."""
        # An open stream would keep the server from stopping; the clients come back after a pause.
        self._streams.end()
        if self.server is not None and self.task is not None:
            await self.server.stop(self.task)
