"""A building of invented zones behind the real HTTP server, in a thread of its own: for tests with a real browser."""

import asyncio
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from prometheus_client import CollectorRegistry
from support.fake_zones import FakeZone, announced, make_update
from support.processes import fetch
from support.served import config

from service.forecast.ahead import LookingAhead
from service.publish.events import Streams
from service.web.app import create_app
from service.web.server.server import HttpServer
from service.web.site import Backend

KEPT = 300
"""Updates that a zone keeps: a day of 5 min, and no more, however long a test streams."""


class Building:
    """Zones that are served; `step` lets them have news, `offline` takes them away for a while."""

    def __init__(
        self, zones: Mapping[str, FakeZone], site: str = "htwg", time_zone: str | None = "Europe/Berlin"
    ) -> None:
        self.zones = dict(zones)
        self.site = site
        self.url = ""
        self._time_zone = time_zone
        self._streams = Streams()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._server: HttpServer | None = None
        self._tasks: list[asyncio.Task[None]] = []

    def open(self) -> None:
        """Serve, on the same port as before if there was one."""
        if not self._thread.is_alive():
            self._thread.start()
        self._in_loop(self._open())
        # FastAPI prepares its routes at the first request, with filters of warnings that threads share.
        fetch(f"{self.url}/nowhere")

    def offline(self) -> None:
        """Stop serving: connections break, and new ones are refused."""
        self._in_loop(self._shut())

    def close(self) -> None:
        """End everything."""
        if self._server is not None:
            self.offline()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def step(self, *names: str, **changes: Any) -> None:
        """The next sample of these zones (none: all); `changes` are attributes that they take on."""
        for name in names or tuple(self.zones):
            zone = self.zones[name]
            for attribute, value in changes.items():
                setattr(zone, attribute, value)
            if zone.updates:
                after = (zone.updates[-1].time - zone.updates[0].time) // 300 + 1
                first = (zone.updates[0].time - make_update(0).time) // 300
                zone.updates = [*zone.updates[-KEPT + 1 :], make_update(first + after, zone.network)]
            news = announced(name, zone.now().update, zone.now().status, site=self.site)
            for sink in (self._streams, self._ahead.news):
                sink.publish(news)

    def remove(self, name: str) -> None:
        """A reload without this zone."""
        del self.zones[name]
        self._streams.remove(name)

    def call(self, work: Callable[[], Any]) -> Any:
        """`work` in the event loop."""

        async def run() -> Any:
            return work()

        return self._in_loop(run())

    def _in_loop(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(180)

    async def _open(self) -> None:
        port = int(self.url.rpartition(":")[2]) if self.url else 0
        self._streams = Streams()
        self._ahead = LookingAhead(self.site, self.zones, [self._streams])
        app = create_app(
            self.site,
            self.zones,
            CollectorRegistry(),
            backend=Backend(time_zone=self._time_zone, streams=self._streams),
        )
        self._server = HttpServer(app, config(port=port))
        self._tasks = [asyncio.create_task(self._server.run()), asyncio.create_task(self._ahead.run())]
        await self._server.started(self._tasks[0])
        self.url = self._server.url

    async def _shut(self) -> None:
        self._streams.end()
        serving, looking = self._tasks
        looking.cancel()
        await self._server.stop(serving)
        self._server.close()
        self._server = None


@contextmanager
def building(zones: Mapping[str, FakeZone], **options: Any) -> Iterator[Building]:
    """A building that is served while the context lasts."""
    served = Building(zones, **options)
    served.open()
    try:
        yield served
    finally:
        served.close()
