"""What every recorded source does: it plays a stretch of time at its pace, until it is closed."""

import asyncio
from collections.abc import Sequence
from math import inf, isfinite

from adapters.channel import Binding, RecordedConfig
from adapters.reading import Source

_LONGEST_SLEEP = 0.5
"""How long a paced source may sleep without looking whether it was closed, in s."""


class RecordedSource(Source):
    """A recording, as fast as possible or at a pace, a multiple of real time."""

    def __init__(self, name: str, table: RecordedConfig, bindings: Sequence[Binding]) -> None:
        self.name = name
        self._pace, self._closed = table.pace, False
        self._edges = [(one.id, one.edge()) for one in bindings]
        self._origin: tuple[float, float] | None = None
        """The time of the loop and of the recording at which it began to play."""

    async def close(self) -> None:
        self._closed = True

    async def _due(self, time: float) -> bool:
        """Wait until `time` (UTC s) of the recording is due, counted from the first so that sleeping adds no drift;
        whether the source is still open then. The event loop gets its turn."""
        await asyncio.sleep(0)
        while not self._closed and (delay := self._delay(time)) > 0:
            await asyncio.sleep(min(delay, _LONGEST_SLEEP))
        return not self._closed

    def _delay(self, time: float) -> float:
        """Seconds until `time` is due; 0 or less if it is already."""
        if self._pace == inf or not isfinite(time):
            return 0.0
        real = asyncio.get_running_loop().time()
        if self._origin is None:
            self._origin = (real, time)
        return self._origin[0] + (time - self._origin[1]) / self._pace - real
