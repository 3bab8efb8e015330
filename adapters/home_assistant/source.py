"""The history of Home Assistant as a source of readings."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from math import isfinite

import numpy as np

from adapters.channel import Binding
from adapters.edge import Converter, newest
from adapters.errors import SourceError, SourceUnavailable, said_of
from adapters.home_assistant import database
from adapters.home_assistant.config import HomeAssistantConfig
from adapters.home_assistant.database import Stretches
from adapters.pacing import Pacer
from adapters.reading import Batch, Probe, Reading

_WINDOW = 6 * 3600.0
"""s of history in one batch without a pace."""

_EVERY = 60.0
"""s from one reading of a value that holds to the next: an interval's mean then weighs each value by how long it
held."""


class RecorderSource:
    """The database of Home Assistant's recorder, as fast as possible or at a pace.

    Of states a value holds until the next state, which is read again every minute; "unavailable", "unknown"
    and what else is no number is missing. Of statistics it is the mean of each hour. A counter's value is read when
    it changes.
    """

    def __init__(self, name: str, table: HomeAssistantConfig, bindings: Sequence[Binding]) -> None:
        self.name = name
        self._file, self._data, self._pace = table.file, table.data, table.multiple
        self._channels = [(one.id, one.channel.read, one.channel.stated_unit, one.edge()) for one in bindings]
        """Of each channel its id, its entity, the unit that this may state, and its edge."""
        self._closed = False

    def check(self) -> list[str]:
        """One sentence for a database that cannot be read, and for every entity that it lacks or has in another
        unit."""
        wanted = [(entity, unit) for _, entity, unit, _ in self._channels]
        try:
            with database.opened(self._file, self._data) as connection:
                found = database.problems(connection, self._file, self._data, wanted)
        except SourceError as error:
            found = [str(error)]
        return [f"sources.{self.name}: {problem}" for problem in found]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """Deliver the readings from UTC second `start` on. Raises SourceUnavailable if the file cannot be read."""
        pacer = Pacer(self._pace)
        converters = [Converter(channel, edge) for channel, _, _, edge in self._channels]
        histories = await asyncio.to_thread(self._read)
        known = [history for history in histories if len(history.begins)]
        if not known:
            return
        first = min(float(history.begins[0]) for history in known)
        last = max(float(history.ends[-1]) for history in known)
        window = _WINDOW if self._pace is None else _EVERY
        begin = (first if start is None else max(first, start)) // window * window
        while begin <= last and not self._closed:
            end = begin + window
            await pacer.wait(end, lambda: self._closed)
            readings = [
                reading
                for history, converter in zip(histories, converters, strict=True)
                for reading in _readings(history, converter, begin, end)
                if start is None or not reading.time < start
            ]
            if self._closed:
                return
            yield Batch(sorted(readings, key=lambda reading: reading.time), min(end, last))
            begin = end

    async def probe(self, seconds: float) -> list[Probe]:
        """The newest value of every channel."""
        histories = await asyncio.to_thread(self._read)
        probes = []
        for (channel, entity, _, edge), history in zip(self._channels, histories, strict=True):
            if not len(history.begins):
                raise SourceUnavailable(f"sources.{self.name}: file '{self._file}' has nothing of '{entity}'")
            probes.append(newest(channel, str(entity), edge, float(history.values[-1]), float(history.begins[-1])))
        return probes

    async def close(self) -> None:
        """End the delivery; safe to call twice."""
        self._closed = True

    def _read(self) -> list[Stretches]:
        read = database.states if self._data == "states" else database.statistics
        with said_of(self.name), database.opened(self._file, self._data) as connection:
            return [read(connection, entity) for _, entity, _, _ in self._channels]


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
