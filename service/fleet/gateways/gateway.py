"""A gateway: the whole REST API of every zone, on one machine of the cluster."""

import asyncio
import logging
from collections.abc import Mapping
from contextlib import AsyncExitStack
from typing import Any

from prometheus_client import CollectorRegistry

from service.config.fitting import surroundings
from service.config.site import Config
from service.daemon.composition import answer_on_zenoh
from service.daemon.logs import configure_logging
from service.daemon.process import collect_garbage
from service.daemon.serving import Serving
from service.daemon.tasks import end
from service.daemon.zone_table import Zones
from service.errors import ReloadRefused, ServiceError
from service.fleet.gateways.posts import Posts
from service.fleet.gateways.scrape import FleetCollector
from service.fleet.gateways.views import RemoteZone, ShardView
from service.fleet.member import Member
from service.fleet.messages import News
from service.fleet.peers import Peer
from service.fleet.plan import Plan
from service.publish.zenoh import KIND as ZENOH_KIND

RELOAD_SECONDS = 30.0
"""How long a reload that a client asks for waits for `thermogate fleet run`, which has the configuration."""
AGAIN = 0.3
"""Pause before a shard that could not be reached is asked again, s."""

_log = logging.getLogger(__name__)


class Gateway(Member):
    """The body of a gateway. It serves from its first plan on."""

    def __init__(self, site: str, name: str) -> None:
        super().__init__(site, name)
        self._zones: Zones[RemoteZone] = Zones()
        self._shards: dict[str, tuple[ShardView, asyncio.Task[None]]] = {}
        self._posts = Posts()
        self._serving: Serving | None = None
        self._problem = ""
        self._reloads: list[asyncio.Future[str]] = []
        """Reloads that clients asked for and nobody has done yet."""
        self._rest = AsyncExitStack()
        """What has been opened besides."""

    def state(self) -> Mapping[str, Any]:
        about: dict[str, Any] = {"zones": len(self._zones), "problems": [self._problem] if self._problem else []}
        about["reload_wanted"] = not all(one.done() for one in self._reloads)
        serving = self._serving
        if serving is not None and serving.server is not None and serving.task is not None and not serving.task.done():
            about |= {"ready": True, "url": serving.server.url}
        return about

    async def adopt(self, plan: Plan) -> frozenset[str]:
        """Serve the zones of `plan` from now on."""
        config = plan.config
        configure_logging(config.log)
        for name in set(self._shards) - set(plan.shards):
            await end([self._shards.pop(name)[1]])
        for name in plan.shards:
            if name not in self._shards:
                view = ShardView(Peer(self.site, name))
                self._shards[name] = view, asyncio.create_task(self._listen(view))
        owner = {zone: self._shards[name][0] for zone, name in plan.owners().items()}
        around = surroundings(config)
        self._zones.replace(
            {
                table.id: RemoteZone(table, around[table.id], owner[table.id], self._zones.get(table.id))
                for table in config.zones
            }
        )
        self._posts.adopt(config, {zone: view.peer for zone, view in owner.items()})
        if self._serving is None:
            await self._serve(config)
        else:
            self._serving.reload()
        return frozenset()

    async def end(self) -> None:
        """Serve nobody any more."""
        await end([task for _, task in self._shards.values()])
        if self._serving is not None:
            await self._serving.stop()
        await self._rest.aclose()

    async def _serve(self, config: Config) -> None:
        registry = CollectorRegistry()
        loop = asyncio.get_running_loop()
        registry.register(FleetCollector(loop, lambda: [view.peer for view, _ in self._shards.values()]))
        self._serving = serving = Serving(config)
        try:
            server, _ = serving.open(
                self._zones, registry, problems=self._problems, reload=self._reload, take=self._posts.take
            )
            await serving.start()
            self._rest.push_async_callback(end, [asyncio.create_task(collect_garbage())])
            # A shard answers what is asked on Zenoh about its zones.
            session = await asyncio.to_thread(ZENOH_KIND.open, config.table(ZENOH_KIND.name), self.site)
            if session is not None:
                self._rest.push_async_callback(asyncio.to_thread, session.close)
                await answer_on_zenoh([session], config, self._zones)
        except ServiceError as error:
            # The other machines serve all zones too; the steward shows what is wrong with this one.
            _log.error("%s", error)
            self._problem = str(error)
            return
        _log.info("%s serves %d zones on %s", self.name, len(self._zones), server.url)

    async def reloaded(self, done: str, problems: list[str]) -> None:
        """The reload that clients asked for is `done`, or refused for these `problems`."""
        for each in self._reloads:
            if not each.done():
                each.set_exception(ReloadRefused(problems)) if problems else each.set_result(done)
        self._reloads.clear()

    async def _reload(self) -> str:
        """Have the configuration read again where it is; what that changed, as one line. Raises ReloadRefused."""
        self._reloads.append(asked := asyncio.get_running_loop().create_future())
        try:
            async with asyncio.timeout(RELOAD_SECONDS):
                return await asked
        except TimeoutError:
            sentence = (
                f"`thermogate fleet run`, which reads the configuration, has not done so for {RELOAD_SECONDS:.0f} s; "
                "see that it runs and what its log says, and ask again"
            )
            raise ReloadRefused([sentence]) from None

    def _problems(self) -> list[str]:
        silent = [view.peer.name for view, _ in self._shards.values() if view.silence() is not None]
        return [f"shards that do not answer: {', '.join(silent)}"] if silent else []

    async def _listen(self, view: ShardView) -> None:
        """Hear, for ever, what a shard's zones announce."""
        boot, since = "", 0
        while True:
            try:
                news: News = await view.peer.ask("news", boot, since, timeout=30.0)
            except ServiceError:
                await asyncio.sleep(AGAIN)
                continue
            boot, since = news.boot, news.version
            view.heard(news)
            for one in news.zones:
                zone = self._zones.get(one.zone)
                if zone is None or zone.shard is not view:
                    continue
                zone.told = one.state
                if self._serving is not None:
                    for sink in self._serving.sinks:
                        sink.publish(one)
