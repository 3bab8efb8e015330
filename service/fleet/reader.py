"""The reader: reads every shared source once, and hands each shard what its zones ask for.

What it has read it keeps until it is durable in the shards: a shard that starts anew, or a zone that moves, gets it
again. What clients post does not come this way; the gateways take it to the shards.
"""

from __future__ import annotations

import asyncio
import logging
import os
import secrets

from service.daemon.logs import configure_logging
from service.daemon.tasks import end
from service.fleet.lines import Line
from service.fleet.messages import Beat
from service.fleet.peers import Peer, go_on, own_node
from service.fleet.plan import Plan

_log = logging.getLogger(__name__)


class Reader:
    """The body of the reader."""

    def __init__(self, site: str, name: str) -> None:
        self._site, self._name = site, name
        self._boot, self._node = secrets.token_hex(8), own_node()
        self._plan: Plan | None = None
        self._lines: dict[str, tuple[Line, asyncio.Task[None]]] = {}
        self._adopting = asyncio.Lock()
        self._waking: asyncio.Task[None] | None = None

    async def wake(self) -> None:
        """Go on with the plan of before, if there is one."""
        self._waking = asyncio.create_task(go_on(self._site, self.adopt))

    async def beat(self) -> Beat:
        """A sign of life."""
        problems = [problem for line, _ in self._lines.values() for problem in line.problems()]
        version = 0 if self._plan is None else self._plan.version
        return Beat(self._name, self._boot, self._node, os.getpid(), version, len(self._lines), version > 0, problems)

    async def adopt(self, plan: Plan) -> None:
        """Read for the shards of `plan` from now on."""
        async with self._adopting:
            before = self._plan
            if before is not None and plan.version <= before.version:
                return
            if before is None or before.config.log != plan.config.log:
                configure_logging(plan.config.log)
            wanted = {
                name: table
                for name, table in plan.config.sources.items()
                if table.kind != "http" and plan.config.zones_of(name)
            }
            for name in set(self._lines) - set(wanted):
                await self._stop(name)
            for name in wanted:
                line, _ = self._lines.get(name, (None, None))
                if line is not None and line.can_follow(plan):
                    line.assign(plan)
                    continue
                if line is not None:
                    await self._stop(name)
                line = Line(name, plan, self._peer, line)
                self._lines[name] = line, asyncio.create_task(line.run(), name=f"source {name}")
            self._plan = plan

    async def stop(self) -> None:
        """Read nothing any more."""
        async with self._adopting:
            for name in list(self._lines):
                await self._stop(name)

    async def _stop(self, name: str) -> None:
        line, task = self._lines.pop(name)
        await end([task])
        await line.close()

    def _peer(self, shard: str) -> Peer:
        return Peer(self._site, shard)
