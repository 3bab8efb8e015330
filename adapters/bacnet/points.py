"""What the values of a BACnet object mean to the channels: readings for the daemon, and probes for a person."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from adapters.bacnet.objects import parse_object
from adapters.bacnet.units import NO_UNITS, differs, unit_of
from adapters.bacnet.values import Flags, Unreadable, Value, flags, number
from adapters.channel import Binding
from adapters.reading import Fault, Probe, Quality
from adapters.watched import POLLS_IN_A_STRETCH, Verdict, Watched


class BacnetChannel(Watched):
    """A channel at work on an object; a value in another unit than `unit` (None: any) is refused."""

    def __init__(self, binding: Binding, poll: float) -> None:
        super().__init__(binding, POLLS_IN_A_STRETCH * poll)
        channel = binding.channel
        self.device: int = channel.device
        self.object = parse_object(channel.object)
        self.point = self.device, self.object
        self.unit: str | None = channel.stated_unit if channel.compare_units else None
        self.address: str | None = channel.at
        self.cov = bool(channel.cov)


class Seen(NamedTuple):
    """The present value of an object, its status flags if it has them, the number of the unit if it states one."""

    value: Value
    flags: Value | None = None
    units: int | None = None


def judged(channel: BacnetChannel, seen: Seen) -> Verdict:
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


def addresses(channels: Iterable[BacnetChannel]) -> dict[int, str | None]:
    """Every device of `channels`, with its address where one is given."""
    found: dict[int, str | None] = {}
    for channel in channels:
        found[channel.device] = found.get(channel.device) or channel.address
    return found


def probed(channel: BacnetChannel, seen: Seen, when: float, hints: Sequence[str] = ()) -> Probe:
    """What a person should know about what was `seen` for `channel` at `when` (UTC s)."""
    verdict = judged(channel, seen)
    stated = "" if seen.units is None else f" {unit_of(seen.units) or f'(unit {seen.units})'}"
    return channel.probed(verdict, "-" if verdict.raw is None else f"{verdict.raw:.6g}{stated}", when, hints)
