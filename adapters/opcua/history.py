"""The history of an OPC UA server as a database of time series."""

from typing import Any

import numpy as np

from adapters.opcua.client import OpcuaLink
from adapters.opcua.config import OpcuaHistoryConfig
from adapters.series.database import Database, Points


class History(Database):
    """What a server has recorded (part 11, Historical Access), over one session that is opened when it is needed."""

    def __init__(self, table: OpcuaHistoryConfig) -> None:
        super().__init__(table)
        self._link: OpcuaLink | None = None

    async def points(self, channel: Any, begin: float, end: float, counter: bool) -> Points:
        """Values at begin, begin + step, ..., each recorded at most `hold` s before and not ended by a bad one."""
        if self._link is None:
            self._link = OpcuaLink(self.table)
            await self._link.open()
        recorded = [
            (seen.time, verdict.raw)
            for seen in await self._link.history(channel.node, begin - self.table.hold, end)
            if seen.time is not None and ((verdict := seen.judged()).raw is not None or verdict.fault is not None)
        ]
        times, values = np.array(sorted(recorded, key=lambda one: one[0]), dtype=np.float64).reshape(-1, 2).T
        grid = np.arange(begin, end, self.table.step)
        last = np.searchsorted(times, grid, "right") - 1
        known = np.flatnonzero(last >= 0)
        known = known[(grid[known] - times[last[known]] <= self.table.hold) & np.isfinite(values[last[known]])]
        return Points(grid[known], values[last[known]])

    async def close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            await link.close()
