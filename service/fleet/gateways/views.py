"""The zones of all shards as a gateway sees them: what they told last, and what is asked of them."""

import asyncio
import time
from collections.abc import Mapping
from typing import Any, Self

from service.config.site import ZoneConfig
from service.errors import ServiceError
from service.fleet.messages import News
from service.fleet.peers import Peer
from service.records.asker import current_asker
from service.records.history import HistoryRow
from service.records.outlook import Surroundings
from service.records.series import Series
from service.records.status import ZoneState, ZoneStatus
from service.records.trust import Trust
from service.records.view import Answer, Question

ANSWER_SECONDS = 60.0
"""How long a question to a zone may take."""
LOOK = 1.0
"""How often it is looked whether the client still waits for its answer, s."""
SILENT_SECONDS = 10.0
"""A shard that has not answered for so long is not believed any more to run its zones."""


class ShardView:
    """A shard: whom to ask, and when it last answered."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.heard_at: float | None = None
        """Monotonic s."""
        self.refused: Mapping[str, str] = {}

    def heard(self, news: News) -> None:
        self.heard_at = time.monotonic()
        self.refused = news.refused

    def silence(self) -> str | None:
        """Why nothing is known of its zones now; None where it answers."""
        if self.heard_at is None:
            return f"{self.peer.name}, which is to run it, is starting"
        silent = time.monotonic() - self.heard_at
        if silent <= SILENT_SECONDS:
            return None
        return f"{self.peer.name}, which runs it, has not answered for {silent:.0f} s; it is being started anew"


class RemoteZone:
    """A zone in another process (`service.records.view.ZoneView`)."""

    def __init__(self, table: ZoneConfig, around: Surroundings, shard: ShardView, before: Self | None) -> None:
        """`before` is the zone of an earlier configuration: what is known of it stays while the network does."""
        self.id = table.id
        self.network = table.network
        self.period = float(table.period)
        self.estimator = table.estimator
        self.surroundings = around
        self.shard = shard
        self.told: ZoneState | None = None if before is None or before.network != table.network else before.told
        """What its shard last said of it."""

    def now(self) -> ZoneState:
        """What its shard last said of it, as far as that is to be believed."""
        refused, silence = self.shard.refused.get(self.id), self.shard.silence()
        if self.told is not None and refused is None and silence is None:
            return self.told
        state, update, trust = self.told or ZoneState(self._unknown(), None, Trust())
        if refused is not None:
            state = self._unknown()._replace(state="failed", reason=refused)
        elif self.told is None:
            state = state._replace(reason=silence or "it is being restored")
        else:
            state = state._replace(state="stalled", reason=silence or "")
        return ZoneState.of(state, update, trust)

    async def ask(self, question: Question[Answer]) -> Answer:
        return await self._ask("ask", question)

    async def history(self, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """History rows, oldest first."""
        return await self._ask("history", start, end, limit)

    async def series(self, start: int, end: int, points: int) -> Series:
        """The history of [start, end), UTC s, thinned out."""
        return await self._ask("series", start, end, points)

    async def _ask(self, method: str, *arguments: Any) -> Any:
        asker = current_asker()
        question = (asker.name, self.id, method, arguments)
        asked = asyncio.ensure_future(self.shard.peer.ask("question", *question, timeout=ANSWER_SECONDS, give_up=True))
        try:
            while not (await asyncio.wait([asked], timeout=LOOK))[0]:
                if asker.gone.is_set():
                    raise ServiceError("the question was given up because nobody waits for it")
            return asked.result()
        finally:
            asked.cancel()

    def _unknown(self) -> ZoneStatus:
        return ZoneStatus("waiting", "", None, 0, 0, {}, {}, channels=self.network.channels)
