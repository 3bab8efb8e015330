"""What the values of a BACnet object mean to the channels: readings for the daemon, and probes for a person."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from adapters.bacnet.objects import ObjectId, parse_object
from adapters.bacnet.units import NO_UNITS, differs, unit_of
from adapters.bacnet.values import Flags, Tagged, Unreadable, flags, number
from adapters.channel import Binding, Watched, put_to_work
from adapters.reading import Fault, Probe, Quality, Reading

# Counts that lie further apart than so many polls make no power: what was used meanwhile is not what is used now.
_POLLS_IN_A_STRETCH = 10


class BacnetChannel(Watched):
    """A channel at work: the object whose present value it is. A value is refused where the device states another unit
    than `unit`, None for any."""

    def __init__(self, binding: Binding, poll: float) -> None:
        super().__init__(binding, _POLLS_IN_A_STRETCH * poll)
        channel = binding.channel
        self.device: int = channel.device
        self.object = parse_object(channel.object)
        self.unit: str | None = channel.stated_unit if channel.compare_units else None
        self.address: str | None = channel.at
        self.cov = bool(channel.cov)

    @property
    def is_temperature(self) -> bool:
        """Whether it is known to be a temperature."""
        return self.unit in ("degC", "K", "degF")

    @property
    def place(self) -> str:
        """Where it stands, in the operator's words."""
        return f"device {self.device} {self.object}"


class Seen(NamedTuple):
    """What a device last said of an object: present value, status flags where it has them, and the number of the unit,
    None where it states none."""

    value: Tagged
    flags: Tagged | None = None
    units: int | None = None


class Verdict(NamedTuple):
    """The number in what was seen, and how far it can be believed, with the sentence for a person."""

    raw: float | None
    quality: Quality
    fault: Fault | None = None
    sentence: str = "good"


def judged(channel: BacnetChannel, seen: Seen) -> Verdict:
    """What `seen` says to `channel`."""
    try:
        stated = Flags() if seen.flags is None else flags(seen.flags)
        raw = number(seen.value)
    except Unreadable as error:
        return Verdict(None, Quality.BAD, Fault.NON_NUMERIC, f"not usable: the value or its status {error}")
    if raw is None:
        return Verdict(None, Quality.BAD, Fault.NOT_AVAILABLE, "not available: the device has no value here now")
    if stated.quality is Quality.BAD:
        return Verdict(raw, Quality.BAD, Fault.REPORTED_BAD, f"reported bad: its status is {stated}")
    if channel.unit is not None and differs(seen.units, channel.unit):
        ours = unit_of(seen.units or NO_UNITS)
        remedy = f'write unit = "{ours}"' if ours else "no channel can have that"
        sentence = f"wrong unit: the device states {ours or f'unit {seen.units}'}; {remedy}, or compare_units = false"
        return Verdict(raw, Quality.BAD, Fault.WRONG_UNIT, sentence)
    sentence = "good" if stated.quality is Quality.GOOD else f"uncertain: its status is {stated}"
    return Verdict(raw, stated.quality, None, sentence)


class Channels:
    """The channels of a source by device and object."""

    def __init__(self, bindings: Sequence[Binding], poll: float) -> None:
        self._poll = poll
        self._at: dict[tuple[int, ObjectId], list[BacnetChannel]] = {}
        self.replace(bindings)

    def replace(self, bindings: Sequence[Binding]) -> None:
        """These are the channels from now on; what is remembered of those that stay is kept."""
        before = [channel for at_object in self._at.values() for channel in at_object]
        self._at = {}
        for channel in put_to_work(bindings, before, lambda one: BacnetChannel(one, self._poll)):
            self._at.setdefault((channel.device, channel.object), []).append(channel)

    @property
    def devices(self) -> dict[int, str | None]:
        """Every device, with its address where one is given."""
        found: dict[int, str | None] = {}
        for (device, _), at_object in self._at.items():
            addresses = [channel.address for channel in at_object if channel.address]
            found[device] = found.get(device) or next(iter(addresses), None)
        return found

    def objects(self, device: int) -> list[ObjectId]:
        """The objects of `device` that have channels."""
        return [object for one, object in self._at if one == device]

    def may_subscribe(self, device: int, object: ObjectId) -> bool:
        """Whether every channel of the object allows a subscription."""
        return all(channel.cov for channel in self._at[device, object])

    def names(self, device: int, object: ObjectId) -> str:
        """The channels of an object and where that is, for the log."""
        at_object = self._at[device, object]
        return f"{', '.join(channel.id for channel in at_object)} ({at_object[0].place})"

    def readings(self, device: int, object: ObjectId, seen: Seen, when: float) -> Iterator[Reading]:
        """The readings that `seen` brings at `when` (UTC s)."""
        for channel in self._at.get((device, object), ()):
            reading = _reading(channel, seen, when)
            if reading is not None:
                yield reading

    def refused(self, device: int, object: ObjectId) -> Iterator[Reading]:
        """Bad readings of the channels of an object that the device does not give away."""
        at_object = self._at.get((device, object), ())
        return (channel.converter.bad(time.time(), Fault.REFUSED_BY_DEVICE) for channel in at_object)


def _reading(channel: BacnetChannel, seen: Seen, when: float) -> Reading | None:
    verdict = judged(channel, seen)
    if verdict.fault is not None or verdict.raw is None:
        return channel.converter.bad(when, verdict.fault or Fault.NOT_AVAILABLE)
    return channel.converter.reading(when, verdict.raw, verdict.quality, seen.value)


def probed(channel: BacnetChannel, seen: Seen, when: float, hints: Sequence[str] = ()) -> Probe:
    """What a person should know about what was `seen` for `channel` at `when` (UTC s)."""
    verdict = judged(channel, seen)
    edge, raw = channel.edge, verdict.raw
    stated = "" if seen.units is None else f" {unit_of(seen.units) or f'(unit {seen.units})'}"
    shown = "-" if raw is None else f"{raw:.6g}{stated}"
    if raw is None or verdict.fault is not None:
        return Probe(channel.id, channel.place, shown, None, when, verdict.sentence, tuple(hints))
    if edge.counter:
        stand = f"the counter stands at {raw * edge.scale + edge.offset:g}"
        return Probe(channel.id, channel.place, shown, None, when, verdict.sentence, (stand, *hints))
    value = edge.value(raw)
    return Probe(channel.id, channel.place, shown, value, when, edge.doubt(value) or verdict.sentence, tuple(hints))
