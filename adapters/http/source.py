"""Live telemetry that clients post over HTTP: from posted values to readings of channels."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from copy import copy
from math import inf
from typing import NamedTuple

from adapters.channel import Binding
from adapters.edge import LiveConverter
from adapters.http.config import HttpSourceConfig
from adapters.http.posted import Posted
from adapters.reading import Batch, Fault, Probe, Quality, Reading, Source
from adapters.timestamps import EARLIEST
from adapters.watched import Watched, put_to_work

_UNHEARD = "this source is posted to, and only the running daemon hears that; look at last_good in GET /zones/{zone}"


class Received(NamedTuple):
    """What a post brings: readings in the order of time, and how many first counts, which are no power yet."""

    readings: list[Reading]
    begun: int
    counters: tuple[tuple[HttpChannel, _Count, float], ...]
    """Counters that have counted on, each with its last count before the post and the time of that after it."""

    def take_back(self, zone: str) -> None:
        """`zone` could not take its readings: its counters forget this post, unless another one has come since."""
        for counter, before, until in self.counters:
            if counter.zone == zone and counter.counted.until == until:
                counter.counted = before


class HttpSource(Source):
    """Channels that are posted to. `receive` makes readings of a post at once; there is nothing to connect to."""

    def __init__(self, name: str, table: HttpSourceConfig, bindings: Sequence[Binding]) -> None:
        self.name = name
        self._max_ahead, self._longest_stretch = table.max_ahead, table.longest_stretch
        self._listed: list[HttpChannel] = []
        self._named: dict[str, list[HttpChannel]] = {}
        self._measured: dict[tuple[object, ...], list[HttpChannel]] = {}
        """By measurement, field and one of the tags, of which there may be many channels' own."""
        self._tags: set[str] = set()
        self._news = asyncio.Event()
        self.rebind(bindings)

    def rebind(self, bindings: Sequence[Binding]) -> None:
        """These are the channels from now on; what is remembered of those that stay is kept."""
        self._listed = put_to_work(bindings, self._listed, lambda one: HttpChannel(one, self._longest_stretch))
        self._named, self._measured = {}, {}
        for channel in self._listed:
            for name in {channel.id, channel.name} - {None}:
                self._named.setdefault(str(name), []).append(channel)
            tag = next(iter(channel.tags.items()), ())
            self._measured.setdefault((channel.measurement, channel.field, *tag), []).append(channel)
        self._tags = {str(key[2]) for key in self._measured if len(key) > 2}

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """An empty batch whenever something was posted: the readings went to the zones while the client waits."""
        while True:
            await self._news.wait()
            self._news.clear()
            yield Batch([], -inf)

    async def probe(self, seconds: float) -> list[Probe]:
        """Where to look instead: nobody posts to a probe."""
        return [Probe(one.id, one.place, "-", None, None, _UNHEARD.format(zone=one.zone)) for one in self._listed]

    def receive(self, posted: Sequence[Posted], zone: str | None = None, now: float | None = None) -> Received:
        """The readings of what was posted at `now` (UTC s), of `zone` alone if given, which names may leave out."""
        arrived = time.time() if now is None else now
        found = [(one, watched) for one in posted for watched in self._meant(one, zone)]
        # Nobody has measured what is to come: the client's clock is ahead, for all that it posts together.
        latest = arrived + self._max_ahead
        values = [one for one, _ in found if not isinstance(one.value, Fault)]
        times = [one.time for one in values if one.time is not None and one.time <= latest]
        ahead = max(times, default=arrived) - arrived
        # Counters need their counts in the order of time.
        found.sort(key=lambda pair: arrived if pair[0].time is None else pair[0].time)
        counting = {id(watched): watched for _, watched in found if watched.edge.counter}.values()
        before = [watched.counted for watched in counting]
        readings = [watched.reading(_dated(one, ahead, latest), arrived, self._max_ahead) for one, watched in found]
        counters = tuple((one, was, one.counted.until) for one, was in zip(counting, before, strict=True))
        if found:
            self._news.set()
        taken = [reading for reading in readings if reading is not None]
        return Received(taken, len(readings) - len(taken), counters)

    def zones_of(self, posted: Posted, zone: str | None = None) -> list[str]:
        return [watched.zone for watched in self._meant(posted, zone)]

    def _meant(self, posted: Posted, zone: str | None) -> list[HttpChannel]:
        if posted.field is None:
            short = [] if zone is None else self._named.get(f"{zone}/{posted.name}", [])
            listed = short or self._named.get(posted.name, [])
        else:
            here, tags = (posted.name, posted.field), posted.tags
            keys = [here, *((*here, tag, tags[tag]) for tag in self._tags if tag in tags)]
            found = (watched for key in keys for watched in self._measured.get(key, ()))
            listed = [
                watched for watched in found if all(tags.get(key) == wanted for key, wanted in watched.tags.items())
            ]
        return [watched for watched in listed if zone in (None, watched.zone)]


class HttpChannel(Watched):
    """What the values of a channel are called where they are posted, and what is remembered of the last ones. `name` is
    what JSON and SenML may call it besides its id; a value with a unit has to be in `unit` (None: in any)."""

    def __init__(self, binding: Binding, longest_stretch: float) -> None:
        super().__init__(binding, longest_stretch)
        self.zone, name = binding.id.split("/", 1)
        channel = binding.channel
        self.name, self.tags, self.unit = channel.name, channel.tags, channel.stated_unit
        self.measurement = channel.measurement or self.zone
        self.field = channel.field or (name if channel.measurement is None else "value")
        self._counted_until = -inf
        tags = "".join(f",{key}={value}" for key, value in self.tags.items())
        self.place = f"{self.name or self.id}, or {self.measurement}{tags} {self.field}"

    @property
    def counted(self) -> _Count:
        return _Count(self._counted_until, copy(self.converter))

    @counted.setter
    def counted(self, count: _Count) -> None:
        self._counted_until, self.converter = count

    def reading(self, posted: Posted, arrived: float, max_ahead: float) -> Reading | None:
        """The reading that `posted` brings; None for the first count of a counter."""
        when = arrived if posted.time is None else posted.time
        if when > arrived + max_ahead:
            return self.converter.bad(arrived, Fault.AHEAD_OF_TIME)
        if when < EARLIEST:
            return self.converter.bad(arrived, Fault.BAD_TIMESTAMP)
        fault = self._fault(posted)
        if fault is not None or isinstance(posted.value, Fault):
            return self.converter.bad(when, fault or Fault.NON_NUMERIC)
        if self.edge.counter:
            if self._counted_until > arrived + max_ahead:
                # It would be refused by now: the clock that dated it was wrong, and has been set back.
                self._counted_until = -inf
            if when <= self._counted_until:
                # Most probably posted a second time, which the zone knows.
                return self.converter.bad(when, Fault.OUT_OF_ORDER)
            self._counted_until = when
        return self.converter.reading(when, posted.value, posted.quality)

    def _fault(self, posted: Posted) -> Fault | None:
        if isinstance(posted.value, Fault):
            return posted.value
        if posted.quality is Quality.BAD:
            return Fault.REPORTED_BAD
        wrong_unit = self.unit is not None and posted.unit not in (None, self.unit)
        return Fault.WRONG_UNIT if wrong_unit else None


class _Count(NamedTuple):
    """The last count of a counter: its time, UTC s, and what makes power of the next one."""

    until: float
    converter: LiveConverter


def _dated(posted: Posted, ahead: float, latest: float) -> Posted:
    """`posted` by a clock that is `ahead` s, if it is more than 0; a time after `latest` stays, to be refused."""
    if ahead <= 0 or posted.time is None or posted.time > latest:
        return posted
    return posted._replace(time=posted.time - ahead)
