"""What shards and gateways have in common: they go by the newest plan that the cluster keeps."""

import asyncio
import logging
import os
import secrets
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from service.daemon.process import favour_the_event_loop
from service.errors import ServiceError
from service.fleet import peers
from service.fleet.messages import Beat
from service.fleet.plan import Plan
from service.pauses import GrowingPause

FIRST_PAUSE, LONGEST_PAUSE = 0.5, 8.0
"""Before a plan that could not be gone by, or not wholly, is tried again, s."""

_log = logging.getLogger(__name__)


class Member(ABC):
    """The body of a member. A new process goes on with the plan of before: the steward may be lost too."""

    def __init__(self, site: str, name: str) -> None:
        self.site, self.name = site, name
        self.boot, self.node = secrets.token_hex(8), peers.own_node()
        self.version = 0
        """Of the plan that it goes by."""
        self.waiting: frozenset[str] = frozenset()
        """Zones that it could not get yet."""
        self.adopting = False
        self._following: asyncio.Task[None] | None = None
        self._stopping = False

    async def wake(self) -> None:
        """Go on with the plan of before, if there is one."""
        favour_the_event_loop()
        self._follow()

    async def beat(self, version: int) -> Beat:
        """A sign of life. The steward goes by the plan of this `version`."""
        if version > self.version:
            self._follow()
        about = Beat(self.name, self.boot, self.node, os.getpid(), self.version, waiting=len(self.waiting))
        return about._replace(**self.state())

    async def stop(self) -> None:
        self._stopping = True
        if self._following is not None:
            await asyncio.wait([self._following])
        await self.end()

    @abstractmethod
    def state(self) -> Mapping[str, Any]:
        """What a sign of life tells besides (`Beat`)."""

    @abstractmethod
    async def adopt(self, plan: Plan) -> frozenset[str]:
        """Go by `plan` from now on; the zones for which that has to be tried again. Raises ServiceError."""

    @abstractmethod
    async def end(self) -> None:
        """Let go of everything."""

    def _follow(self) -> None:
        if self._following is None or self._following.done():
            self._following = asyncio.create_task(self._go_on())

    async def _go_on(self) -> None:
        """Go by the newest plan, as often as it takes."""
        pause = GrowingPause(FIRST_PAUSE, LONGEST_PAUSE)
        while not self._stopping:
            try:
                plan = await asyncio.to_thread(peers.remembered, self.site)
                if plan is None or (plan.version <= self.version and not self.waiting):
                    return
                self.adopting = True
                self.waiting = await self.adopt(plan)
                self.version = plan.version
                if not self.waiting:
                    return
                pause.reset()
            except ServiceError as error:
                _log.error("%s cannot go by the plan yet: %s", self.name, error)
                pause.grow()
            finally:
                self.adopting = False
            await asyncio.sleep(pause.seconds)
