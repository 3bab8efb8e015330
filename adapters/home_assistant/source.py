"""The history of Home Assistant as a source of readings."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from math import inf, isfinite

import numpy as np

from adapters.channel import Binding
from adapters.edge import Converter, looked_at
from adapters.errors import SourceError, SourceUnavailable, said_of
from adapters.home_assistant import database
from adapters.home_assistant.config import HomeAssistantChannelConfig, HomeAssistantConfig
from adapters.home_assistant.database import Stretches
from adapters.playback import RecordedSource
from adapters.reading import Batch, Probe, Reading

_WINDOW = 6 * 3600.0
"""s of history in one batch without a pace."""

_EVERY = 60.0
"""s from one reading of a value that holds to the next: an interval's mean then weighs each value by how long it
held."""


class RecorderSource(RecordedSource):
    """The database of Home Assistant's recorder, as fast as possible or at a pace.

    Of states a value holds until the next state, which is read again every minute; "unavailable", "unknown"
    and what else is no number is missing. Of statistics it is the mean of each hour. A counter's value is read when
    it changes.
    """

    def __init__(self, name: str, table: HomeAssistantConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, table, bindings)
        self._file, self._data = table.file, table.data
        self._wanted: list[HomeAssistantChannelConfig] = [one.channel for one in bindings]

    def check(self) -> list[str]:
        """One sentence for a database that cannot be read, and for every entity that it lacks or has in another
        unit."""
        try:
            with database.opened(self._file, self._data) as connection:
                found = database.problems(connection, self._file, self._data, self._wanted)
        except SourceError as error:
            found = [str(error)]
        return [f"sources.{self.name}: {problem}" for problem in found]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """Deliver the readings from UTC second `start` on. Raises SourceUnavailable if the file cannot be read."""
        converters = [Converter(*one) for one in self._edges]
        histories = await asyncio.to_thread(self._read)
        known = [history for history in histories if len(history.begins)]
        if not known:
            return
        first = min(float(history.begins[0]) for history in known)
        last = max(float(history.ends[-1]) for history in known)
        window = _WINDOW if self._pace is None else _EVERY
        begin = (first if start is None else max(first, start)) // window * window

        async def read(begin: float, end: float) -> list[Reading]:
            return [
                reading
                for history, converter in zip(histories, converters, strict=True)
                # The last state has no length, and belongs to the last window.
                for reading in _readings(history, converter, begin, end if end < last else inf)
                if start is None or not reading.time < start
            ]

        async for batch in self._played(begin if begin != last else begin - window, last, window, read):
            yield batch

    async def probe(self, seconds: float) -> list[Probe]:
        """The newest value of every channel."""
        histories = await asyncio.to_thread(self._read)
        probes = []
        for (channel, edge), wanted, history in zip(self._edges, self._wanted, histories, strict=True):
            if not len(history.begins):
                raise SourceUnavailable(f"sources.{self.name}: file '{self._file}' has nothing of '{wanted.address}'")
            probes.append(
                looked_at(channel, wanted.address, edge, float(history.values[-1]), float(history.begins[-1]))
            )
        return probes

    def _read(self) -> list[Stretches]:
        read = database.states if self._data == "states" else database.statistics
        with said_of(self.name), database.opened(self._file, self._data) as connection:
            return [read(connection, one) for one in self._wanted]


def _readings(history: Stretches, converter: Converter, begin: float, end: float) -> list[Reading]:
    """The readings in [begin, end): at the beginning of each stretch, and again at every whole minute while it
    lasts."""
    found: list[Reading] = []
    first, last = np.searchsorted(history.ends, begin, "right"), np.searchsorted(history.begins, end, "left")
    for began, ended, value in zip(*(rows[first:last].tolist() for rows in history), strict=True):
        if not isfinite(value):
            continue
        times = [began] if began >= begin else []
        if not converter.edge.counter:
            minute = max(began, begin - _EVERY) // _EVERY * _EVERY + _EVERY
            times += np.arange(minute, min(ended, end), _EVERY).tolist()
        found += [reading for time in times if (reading := converter.reading(time, value)) is not None]
    return found
