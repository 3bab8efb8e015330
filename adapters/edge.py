"""From a raw number to a reading in the network's unit: scale, offset, unit, counters, and what is believable."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from time import monotonic

from adapters.reading import Fault, Probe, Quality, Reading
from adapters.units import IDENTITY, Affine


@dataclass(frozen=True)
class Edge:
    """How the raw values of a channel become values in the network's unit. Raw value times `scale` plus `offset` is in
    the channel's own unit; `conversion` takes it to the network's, in which `valid` bounds what is believed. A
    `counter` gives the difference of two readings over the time between them, and starts again from 0 at the raw value
    `rollover` (None: never). Of what lies outside `usual` a person who sets the channel up is told."""

    scale: float = 1.0
    offset: float = 0.0
    conversion: Affine = IDENTITY
    valid: tuple[float, float] = (-inf, inf)
    counter: bool = False
    rollover: float | None = None
    usual: tuple[float, float] = (-inf, inf)

    def value(self, raw: float) -> float:
        """`raw` in the network's unit (of a counter: in that unit times s)."""
        return (raw * self.scale + self.offset) * self.conversion.scale + self.conversion.offset

    def change(self, raw: float) -> float:
        """A change of the raw value by `raw` in the network's unit, without its sign."""
        return abs(raw * self.scale * self.conversion.scale)

    def fault(self, value: float) -> Fault | None:
        """Why `value`, in the network's unit, cannot be believed, or None."""
        if not isfinite(value):
            return Fault.NOT_FINITE
        return None if self.valid[0] <= value <= self.valid[1] else Fault.OUT_OF_RANGE

    def is_usual(self, value: float) -> bool:
        return self.fault(value) is None and self.usual[0] <= value <= self.usual[1]

    def doubt(self, value: float) -> str | None:
        """What a person who sets the channel up should know of `value`, in the network's unit; None if it is usual."""
        fault = self.fault(value)
        if fault is not None:
            lower, upper = self.valid
            return "not a number" if fault is Fault.NOT_FINITE else f"implausible: not within {lower:g} to {upper:g}"
        if self.is_usual(value):
            return None
        return f"doubtful: usually {self.usual[0]:g} to {self.usual[1]:g} here; if it is right, give valid"


PLAIN = Edge()


def looked_at(
    channel: str,
    place: str,
    edge: Edge,
    raw: float,
    when: float | None,
    shown: str = "",
    verdict: str = "good",
    hints: Sequence[str] = (),
) -> Probe:
    """What a person should know of `raw`, which `channel` has at `when` (UTC s); `shown` is how people write it, and
    `verdict` what is said of it where the edge has no doubt."""
    value = edge.value(raw)
    if edge.counter and isfinite(raw):
        stand = f"the counter stands at {raw * edge.scale + edge.offset:g}"
        return Probe(channel, place, shown or f"{raw:g}", None, when, verdict, (stand, *hints))
    known = value if isfinite(raw) else None
    return Probe(channel, place, shown or f"{raw:g}", known, when, edge.doubt(value) or verdict, tuple(hints))


class Converter:
    """Makes readings of `channel` out of raw values that come in the order of time; remembers a counter's last one."""

    def __init__(self, channel: str, edge: Edge, *, dated_at_start: bool = True, longest_stretch: float = inf) -> None:
        """`dated_at_start`: a counter's power is dated when the stretch began that it is the mean of, as in a
        recording, whose time stamps say when a value begins to hold; or when that ended, as in live telemetry, where
        intervals close meanwhile. `longest_stretch`: no power is made of a longer one, in s."""
        self.channel, self.edge = channel, edge
        self._dated_at_start, self._longest = dated_at_start, longest_stretch
        self._last: tuple[float, float, Quality] | None = None

    def reading(self, time: float, raw: float, quality: Quality = Quality.GOOD) -> Reading | None:
        """The reading that `raw` brings; None for the first reading of a counter, which is no power yet."""
        if self.edge.counter:
            return self._power(time, raw, quality)
        return self._believed(time, self.edge.value(raw), quality)

    def bad(self, time: float, fault: Fault) -> Reading:
        return Reading(self.channel, time, nan, Quality.BAD, fault)

    def _power(self, time: float, raw: float, quality: Quality) -> Reading | None:
        if not isfinite(raw):
            return self.bad(time, Fault.NOT_FINITE)
        last, self._last = self._last, (time, raw, quality)
        if last is None or not 0 < time - last[0] <= self._longest:
            return None
        stretch = time - last[0]
        when = last[0] if self._dated_at_start else time
        counted = self._counted(raw - last[1])
        value = counted * self.edge.scale * self.edge.conversion.scale / stretch
        if counted < 0 or (raw < last[1] and self.edge.fault(value)):
            return self.bad(when, Fault.COUNTER_RESET)
        return self._believed(when, value, Quality.UNCERTAIN if Quality.UNCERTAIN in (quality, last[2]) else quality)

    def _counted(self, difference: float) -> float:
        """What was counted between two raw values; less than 0 if the counter was set back."""
        rollover = self.edge.rollover
        # A counter read every few seconds never goes half way round meanwhile: that is a new meter, or one set to 0.
        rolled = difference < 0 and rollover is not None and difference + rollover <= rollover / 2
        return difference + rollover if rolled and rollover is not None else difference

    def _believed(self, time: float, value: float, quality: Quality) -> Reading:
        fault = self.edge.fault(value)
        return Reading(self.channel, time, value, quality) if fault is None else self.bad(time, fault)


class LiveConverter(Converter):
    """A converter of live telemetry, for which a raw value unchanged for `stuck_after` s is uncertain, and for twice as
    long bad: a sensor that works shows its own noise in the last digit."""

    def __init__(self, channel: str, edge: Edge, longest_stretch: float, stuck_after: float | None) -> None:
        """`longest_stretch` [s]: no power is made of a longer one; `stuck_after` None: nothing is ever stuck."""
        super().__init__(channel, edge, dated_at_start=False, longest_stretch=longest_stretch)
        self._stuck_after = inf if stuck_after is None else stuck_after
        self._since = -inf
        self._sent: Hashable = None
        """When the raw value changed last (on a clock that is never set), and what it is."""

    def reading(
        self, time: float, raw: float, quality: Quality = Quality.GOOD, sent: Hashable = None
    ) -> Reading | None:
        """The reading that `raw` brings, of which `sent` is what was sent; None for the first one of a counter."""
        now, sent = monotonic(), raw if sent is None else sent
        if self._since == -inf or sent != self._sent:
            self._since, self._sent = now, sent
        if now - self._since >= 2 * self._stuck_after:
            return self.bad(time, Fault.STUCK)
        stuck = now - self._since >= self._stuck_after
        return super().reading(time, raw, Quality.UNCERTAIN if stuck else quality)
