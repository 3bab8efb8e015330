"""Readings onto the uniform grid of a zone: intervals that close, and the samples that come of them (paper 4.3.1)."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np

from adapters.reading import Fault, Quality, Reading
from adapters.timestamps import EARLIEST, LATEST
from adapters.units import default_valid_range
from estimator.arrays import Array
from estimator.network.network import Network
from service.records.sample import Sample
from service.zone.aggregation import AGGREGATES, Aggregate, Span, default_aggregate

SETPOINT = "setpoint"
"""The channel of what a room is meant to have: observed and kept, but no part of the network."""
SCHEDULED_EVERY = 60.0
"""s between two values of a schedule: an interval in which it changes has its mean."""
MOST_READINGS = 100_000
"""Of one channel in one interval, some MB; what is more is a flood, and no rule for aggregating needs all of it."""


class Rules(NamedTuple):
    """How the readings of a zone become its samples."""

    aggregates: Mapping[str, str] = {}
    """Name of the rule (`service.zone.aggregation`) for each channel; left out, the default for its unit."""
    zone: str | None = None
    """If given, readings are addressed "zone/channel", otherwise "channel"."""
    lateness: float = 0.0
    """How long after its end an interval stays open for late readings, in s."""
    idle_limit: int = 12
    """How many samples of NaN in a row at most."""
    resume_after: int | None = None
    """Time of the last sample before a restart. Readings up to its interval are passed over in silence, for they have
    been processed, and the grid goes on with the next interval."""
    resume_idle: int = 0
    """How many samples of NaN in a row ended with `resume_after`."""
    live: bool = False
    """The sources never deliver anything twice, so that nothing is passed over in silence."""
    earliest: float = EARLIEST
    """No time before it is believed, neither a reading's nor the wall clock's, UTC s."""
    setpoint_age: float | None = None
    """How long a set-point holds after the interval that it is of, in s; None: nobody tells it."""
    known: Mapping[str, Callable[[Array], Array]] = {}
    """Of each channel that no source delivers, since a schedule has it: its values at times (h,) [UTC s]."""


class _Interval(NamedTuple):
    """An open grid interval: per channel the readings by time, and which (channel, time) of them are uncertain."""

    readings: list[dict[float, float]]
    uncertain: set[tuple[int, float]]


class _Meant(NamedTuple):
    """A set-point [degC], and when the interval begins that it is of, UTC s."""

    value: float
    time: int


def unit_of(network: Network, channel: str) -> str:
    """The unit of a zone's `channel`, the set-point among them."""
    return "degC" if channel == SETPOINT else network.channel_unit(channel)


class Alignment:
    """Turns the readings of one zone into samples, one for each closed interval of its grid.

    Interval k is [k period, (k + 1) period) in UTC seconds. It closes when the zone's clock reaches its end plus
    `lateness`; the clock is the least of what its sources say, and a source that has ended no longer counts. For live
    sources the wall clock moves it on as well (`elapse`). Inside open intervals readings may come in any order. A
    channel's usable readings are aggregated; without any its value is NaN. Nothing is ever interpolated.

    The first sample is the first interval with a usable reading. From there an interval without any becomes a sample of
    NaN, but at most `idle_limit` in a row: then the grid falls silent until readings come again. Samples are strictly
    increasing in time.

    A set-point comes with the samples and makes none. It may be told only when it changes, so it holds for a while.
    What is `known` without a source makes no sample either.

    A bad reading is counted in `faults` and not used. So are one that comes after its interval closed (out of order),
    a second one of the same channel and time (duplicated; the first is kept), and what goes beyond MOST_READINGS.
    """

    def __init__(self, network: Network, period: float, sources: Iterable[str], rules: Rules | None = None) -> None:
        """`network` gives the channels and their order; `period` is a whole number of s; `sources` feed the zone."""
        self._rules = rules = rules or Rules()
        aggregates = rules.aggregates
        self.faults: Counter[Fault] = Counter()
        self.last_good: dict[str, float] = {}
        """UTC time of the newest reading of each channel that entered a sample so far."""
        self.refusing: set[str] = set()
        """Channels that their device has refused since then."""
        self.channels = (*network.channels, *(() if rules.setpoint_age is None else (SETPOINT,)))
        """Those of the network in its order, then the set-point if somebody tells it."""
        self._width = len(network.channels)
        self._outputs = len(network.measured)
        self._aggregates: list[Aggregate] = [
            AGGREGATES[aggregates.get(channel) or default_aggregate(unit_of(network, channel))]
            for channel in self.channels
        ]
        # Amounts of energy have no range of their own; the power that they amount to has.
        self._believable = [
            default_valid_range(unit_of(network, channel)) if aggregates.get(channel) == "energy" else (-inf, inf)
            for channel in self.channels
        ]
        prefix = "" if rules.zone is None else f"{rules.zone}/"
        self._slots = {prefix + channel: slot for slot, channel in enumerate(self.channels)}
        self._known = {slot: rules.known[name] for slot, name in enumerate(self.channels) if name in rules.known}
        self._period = int(period)
        self._clocks = dict.fromkeys(sources, -inf)
        self._open: dict[int, _Interval] = {}
        self._resumed = -1 if rules.resume_after is None else rules.resume_after // self._period
        self._closed = self._resumed
        """Index of the last interval that is closed, whether or not a sample came of it."""
        self._next = None if rules.resume_after is None else self._resumed + 1
        """Index of the next interval that has to become a sample; None before the first."""
        self._idle = rules.resume_idle
        self._meant: _Meant | None = None

    def add(self, source: str, readings: Iterable[Reading], now: float) -> list[Sample]:
        """Take in what `source` delivered together with its clock `now` (UTC s); the samples that close by it."""
        begin = end = inf
        rows: list[dict[float, float]] = []
        for channel, time, value, quality, fault in readings:
            if not begin <= time < end or fault is not None or quality is not Quality.GOOD or not isfinite(value):
                index = self._accept(time, value, quality, fault)
                if index is None:
                    if fault is Fault.REFUSED_BY_DEVICE:
                        self.refusing.add(self.channels[self._slots[channel]])
                    continue
                if index not in self._open:
                    self._open[index] = _Interval([{} for _ in self.channels], set())
                interval = self._open[index]
                rows = interval.readings
                begin, end = index * self._period, (index + 1) * self._period
                if quality is Quality.UNCERTAIN and time not in rows[self._slots[channel]]:
                    interval.uncertain.add((self._slots[channel], time))
            row = rows[self._slots[channel]]
            if time in row:
                self.faults[Fault.DUPLICATED] += 1
            elif len(row) >= MOST_READINGS:
                self.faults[Fault.OVERRUN] += 1
            else:
                row[time] = value
        if isfinite(now) and now >= self._rules.earliest:
            self._clocks[source] = max(now, self._clocks.get(source, -inf))
        return self._advance()

    def held(self, channel: str, time: float) -> Reading | None:
        """The usable reading of `channel` at `time` (UTC s) that waits in an open interval."""
        interval = self._open.get(int(time // self._period)) if isfinite(time) else None
        slot = self._slots.get(channel)
        if interval is None or slot is None or time not in interval.readings[slot]:
            return None
        quality = Quality.UNCERTAIN if (slot, time) in interval.uncertain else Quality.GOOD
        return Reading(channel, time, interval.readings[slot][time], quality)

    def elapse(self, now: float) -> list[Sample]:
        """Wall-clock time `now` (UTC s) has come, whatever sources say: the samples that close by it."""
        if now < self._rules.earliest:
            return []
        self._clocks = {source: max(now, clock) for source, clock in self._clocks.items()}
        return self._advance()

    @property
    def closes_at(self) -> float:
        """UTC s at which the next interval closes, if no source has gone past it before."""
        return (self._closed + 2) * self._period + self._rules.lateness

    @property
    def closed_until(self) -> int:
        """UTC s up to which every interval is closed."""
        return (self._closed + 1) * self._period

    def last_before(self, now: float) -> int:
        """Time of the last interval that is over at `now`, UTC s."""
        return (int((now - self._rules.lateness) // self._period) - 1) * self._period

    def set_back(self, now: float) -> None:
        """The wall clock was set back to `now`, and what lies ahead of it was set aside: the grid goes on from there.

        Open intervals are given up; their readings were dated by the clock that was wrong.
        """
        self._open.clear()
        self._clocks = dict.fromkeys(self._clocks, -inf)
        self._closed = self.last_before(now) // self._period
        self._next, self._idle = self._closed + 1, 0
        self.last_good = {channel: when for channel, when in self.last_good.items() if when <= now}

    def end(self, source: str) -> list[Sample]:
        """`source` has come to its end. With the last one every open interval closes, the incomplete one too."""
        self._clocks.pop(source, None)
        return self._advance() if self._clocks else self.flush()

    @property
    def ended(self) -> bool:
        """Whether every source has come to its end."""
        return not self._clocks

    def flush(self) -> list[Sample]:
        """Close every interval that holds a reading, whatever the clock says: the end of a recorded period."""
        return self._close(max(self._open, default=self._closed))

    def _accept(self, time: float, value: float, quality: Quality, fault: Fault | None) -> int | None:
        """Index of the interval that the reading belongs to, or None if it is not used; then its fault is counted."""
        if not self._rules.earliest <= time < LATEST:
            self.faults[fault or Fault.BAD_TIMESTAMP] += 1
            return None
        index = int(time // self._period)
        if index <= self._resumed and not self._rules.live:
            return None
        if fault is None and index <= self._closed:
            fault = Fault.OUT_OF_ORDER
        if fault is None and quality is not Quality.BAD and not isfinite(value):
            fault = Fault.NOT_FINITE
        if fault is not None:
            self.faults[fault] += 1
        return index if fault is None and quality is not Quality.BAD else None

    def _advance(self) -> list[Sample]:
        clock = min(self._clocks.values(), default=-inf)
        if not isfinite(clock):
            return []
        return self._close(int((clock - self._rules.lateness) // self._period) - 1)

    def _close(self, last: int) -> list[Sample]:
        """Close the intervals up to index `last`."""
        if last <= self._closed:
            return []
        samples: list[Sample] = []
        for index in sorted(index for index in self._open if index <= last):
            interval = self._open.pop(index)
            # What is meant from here on does not hold for the silence before.
            samples += self._silence(index)
            self._note_setpoint(index, interval)
            if not any(interval.readings[: self._width]):
                continue
            samples.append(self._sample(index, interval))
            self._idle = 0
            self._next = index + 1
        samples += self._silence(last + 1)
        self._closed = last
        return samples

    def _silence(self, end: int) -> list[Sample]:
        """Samples of NaN for the intervals before index `end`, as far as the limit allows."""
        if self._next is None:
            return []
        begin = self._next
        self._next = max(begin, min(end, begin + self._rules.idle_limit - self._idle))
        self._idle += self._next - begin
        return [self._sample(index, None) for index in range(begin, self._next)]

    def _sample(self, index: int, interval: _Interval | None) -> Sample:
        values: Array = np.full(self._width, np.nan)
        qualities = [Quality.BAD] * self._width
        if interval is not None:
            for slot, readings in enumerate(interval.readings[: self._width]):
                if readings:
                    values[slot], qualities[slot] = self._aggregated(slot, index, readings, interval.uncertain)
        for slot in self._known:
            if slot < self._width:
                values[slot], qualities[slot] = self._scheduled(slot, index)
        split = self._outputs
        return Sample(
            index * self._period,
            values[:split],
            values[split:],
            tuple(qualities[:split]),
            tuple(qualities[split:]),
            self._setpoint(index),
        )

    def _note_setpoint(self, index: int, interval: _Interval) -> None:
        for readings in interval.readings[self._width :]:
            if readings:
                value, quality = self._aggregated(self._width, index, readings, interval.uncertain)
                if quality is not Quality.BAD:
                    self._meant = _Meant(value, index * self._period)

    def _setpoint(self, index: int) -> float:
        """The set-point in the interval; NaN if it is not known, or too old."""
        if self._width in self._known:
            return self._scheduled(self._width, index)[0]
        if self._meant is None or not 0 <= index * self._period - self._meant.time <= (self._rules.setpoint_age or 0.0):
            return nan
        return self._meant.value

    def _scheduled(self, slot: int, index: int) -> tuple[float, Quality]:
        times = index * self._period + np.arange(0.0, self._period, SCHEDULED_EVERY)
        readings = dict(zip(times.tolist(), self._known[slot](times).tolist(), strict=True))
        return self._aggregated(slot, index, readings, set())

    def _aggregated(
        self, slot: int, index: int, readings: dict[float, float], uncertain: set[tuple[int, float]]
    ) -> tuple[float, Quality]:
        rule = self._aggregates[slot]
        times = sorted(readings)
        used = times[rule.used]
        try:
            values = [readings[time] for time in used]
            value = rule.combine(Span(used, values, index * self._period, (index + 1) * self._period))
        except OverflowError:
            return nan, Quality.BAD
        lower, upper = self._believable[slot]
        if not lower <= value <= upper:
            self.faults[Fault.OUT_OF_RANGE] += 1
            return nan, Quality.BAD
        channel = self.channels[slot]
        self.last_good[channel] = times[-1]
        self.refusing.discard(channel)
        doubtful = bool(uncertain) and any((slot, time) in uncertain for time in used)
        return value, Quality.UNCERTAIN if doubtful else Quality.GOOD
