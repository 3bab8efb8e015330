"""A gateway: the whole REST API of every zone, on one machine of the cluster."""

from __future__ import annotations

import asyncio
import logging
import os
import secrets
import signal
from contextlib import AsyncExitStack, suppress
from typing import Any

from prometheus_client import CollectorRegistry

from service.config.site import Config
from service.daemon.composition import answer_on_zenoh
from service.daemon.logs import configure_logging
from service.daemon.process import collect_garbage, favour_the_event_loop
from service.daemon.serving import Serving
from service.daemon.tasks import end
from service.errors import Away, ReloadRefused, ServiceError
from service.fleet.gateways.posts import Posts
from service.fleet.gateways.scrape import FleetCollector
from service.fleet.gateways.views import Mirror, ShardView
from service.fleet.messages import Beat, News
from service.fleet.peers import STEWARD, Peer, go_on, keep_a_spare, own_node
from service.fleet.plan import Plan
from service.pauses import GrowingPause
from service.publish.sinks import Announcement
from service.publish.zenoh import KIND as ZENOH_KIND

AGAIN = 0.3
"""Pause before a shard that could not be reached is asked again, s."""

SPARE_SECONDS, LONGEST_SPARE_SECONDS = 5.0, 300.0
"""How often it is looked whether there is a process to spare, s."""

_log = logging.getLogger(__name__)


class Gateway:
    """The body of a gateway. It serves from its first plan on."""

    def __init__(self, site: str, name: str) -> None:
        self._site, self._name = site, name
        self._boot, self._node = secrets.token_hex(8), own_node()
        self._plan: Plan | None = None
        self._zones = Mirror()
        self._shards: dict[str, tuple[ShardView, asyncio.Task[None]]] = {}
        self._posts = Posts()
        self._serving: Serving | None = None
        self._watching: list[asyncio.Task[Any]] = []
        self._waking: asyncio.Task[None] | None = None
        self._adopting = asyncio.Lock()
        self._problem = ""
        self._opened = AsyncExitStack()
        """The sessions that have been opened."""

    async def wake(self) -> None:
        """Go on with the plan of before, if there is one."""
        favour_the_event_loop()
        self._waking = asyncio.create_task(go_on(self._site, self.adopt))

    async def beat(self) -> Beat:
        """A sign of life."""
        serving = self._serving
        ready = serving is not None and serving.task is not None and not serving.task.done()
        return Beat(
            self._name,
            self._boot,
            self._node,
            os.getpid(),
            0 if self._plan is None else self._plan.version,
            len(self._zones),
            ready,
            [self._problem] if self._problem else [],
            serving.server.url if ready and serving is not None and serving.server is not None else "",
        )

    async def adopt(self, plan: Plan) -> None:
        """Serve the zones of `plan` from now on."""
        async with self._adopting:
            await self._adopt(plan)

    async def _adopt(self, plan: Plan) -> None:
        before = self._plan
        if before is not None and plan.version <= before.version:
            return
        if before is None or before.config.log != plan.config.log:
            configure_logging(plan.config.log)
        for name in set(self._shards) - set(plan.all_shards):
            await end([self._shards.pop(name)[1]])
        for name in plan.all_shards:
            if name not in self._shards:
                view = ShardView(Peer(self._site, name))
                self._shards[name] = view, asyncio.create_task(self._listen(view))
        owner = plan.owners()
        self._zones.adopt(plan.config, owner, lambda name: self._shards[name][0])
        running = {zone: self._shards[name][0] for zone, name in owner.items() if zone not in plan.moving}
        self._posts.adopt(plan.config, running)
        if self._serving is None:
            await self._serve(plan.config)
        else:
            self._serving.reload()
        self._plan = plan

    async def end(self, pid: int) -> None:
        """End a process of this machine that does not answer any more."""
        _log.error("process %d does not answer any more and is ended", pid)
        with suppress(ProcessLookupError, PermissionError):
            os.kill(pid, signal.SIGKILL)

    async def stop(self) -> None:
        """Serve nobody any more."""
        await end([task for _, task in self._shards.values()])
        if self._serving is not None:
            await self._serving.stop()
        await self._opened.aclose()
        await end(self._watching)

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
            self._watching += [asyncio.create_task(collect_garbage()), asyncio.create_task(_keep_a_spare())]
            # A shard answers what is asked on Zenoh about its zones.
            session = await asyncio.to_thread(ZENOH_KIND.open, config.table(ZENOH_KIND.name), self._site)
            if session is not None:
                self._opened.push_async_callback(asyncio.to_thread, session.close)
                await answer_on_zenoh([session], config, self._zones)
        except ServiceError as error:
            # The other machines serve all zones too; the steward shows what is wrong with this one.
            _log.error("%s", error)
            self._problem = str(error)
            return
        _log.info("%s serves %d zones on %s", self._name, len(self._zones), server.url)

    async def _reload(self) -> str:
        """Have the configuration read again; what that changed. Raises ReloadRefused."""
        try:
            done: str = await Peer(self._site, STEWARD).ask("reload")
        except Away as error:
            raise ReloadRefused([f"{error}; ask again in a moment"]) from error
        return done

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
                zone.heard(one)
                announcement = Announcement(self._site, one.zone, one.status, one.update, one.occasion, one.reports)
                if self._serving is not None:
                    for sink in self._serving.sinks:
                        sink.publish(announcement)


async def _keep_a_spare() -> None:
    """See, for ever, that a shard that has to start on this machine finds a process that is ready for it."""
    pause = GrowingPause(SPARE_SECONDS, LONGEST_SPARE_SECONDS)
    while True:
        await asyncio.sleep(pause.seconds)
        # A machine that does not let the idle live is not kept busy with them.
        with suppress(Away):
            if await keep_a_spare():
                pause.reset()
            else:
                pause.grow()
