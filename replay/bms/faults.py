"""The fault menu: what can go wrong in the plant, switched on and off while it runs, at once or later."""

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from adapters.fields.durations import parse_duration
from adapters.fields.problems import own_sentence
from replay.bms.plant import Device
from replay.errors import ReplayError


class FaultError(ReplayError):
    """A fault that the plant cannot have."""


class Kind(NamedTuple):
    """What a kind of fault acts on, what its `value` means, and the value when none is given."""

    scope: str
    default: float | None
    lowest: float
    highest: float
    value_unit: str
    meaning: str


SPIKE_SECONDS = 6.0
"""Of every minute in which a value leaps."""

_ANY = math.inf
MENU: dict[str, Kind] = {
    "freeze": Kind("channel", None, 0, 0, "", "the value stays as it was when the fault began"),
    "nan": Kind("channel", None, 0, 0, "", "no value: NaN in floats, the sentinel in integers, bad quality on Zenoh"),
    "drift": Kind("channel", 0.1, -_ANY, _ANY, "units per minute", "the value moves away from the truth steadily"),
    "offset": Kind("channel", 2.0, -_ANY, _ANY, "units", "the value is too high by so much"),
    "factor": Kind("channel", 0.001, -_ANY, _ANY, "times", "another unit; -1 turns the sign, 0 is a dead meter"),
    "spikes": Kind(
        "channel", 8.0, -_ANY, _ANY, "units", f"for {SPIKE_SECONDS:g} s of every minute the value leaps by so much"
    ),
    "late": Kind("channel", 60.0, 0, 3600, "s", "the value comes so much later; until then it stays as it was"),
    "swapped-words": Kind("registers", None, 0, 0, "", "the words of values longer than one register change places"),
    "exception": Kind("requests", 4.0, 1, 11, "exception code", "requests are answered with a Modbus exception"),
    "slow": Kind("requests", 2.0, 0, 3600, "s", "answers come late"),
    "silent": Kind("requests", None, 0, 0, "", "requests are not answered, and nothing is published on Zenoh"),
    "drop": Kind("requests", None, 0, 0, "", "the TCP connection is closed instead of an answer"),
    "clock-jump": Kind("clock", 3600.0, -_ANY, _ANY, "s", "timestamps of what is published on Zenoh are off"),
    "swapped-sensors": Kind("room", None, 0, 0, "", "the thermometers of the room and outdoors change places"),
    "window": Kind("room", 80.0, 0, 1000, "W/K", "a window is left open: heat is lost that nothing measures"),
}


def _duration(value: object) -> float:
    if isinstance(value, str) and value.replace(".", "", 1).isdecimal():
        value = float(value)
    return parse_duration(value)


Duration = Annotated[float, BeforeValidator(_duration)]


class FaultSpec(BaseModel):
    """A fault as it is asked for. `device` None is every one, `channel` None all of the device's.

    Durations are in real time: a number of seconds, or text such as "5min". Without `for` it lasts until it is removed.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    kind: str
    device: str | None = None
    channel: str | None = None
    value: float | None = Field(default=None, allow_inf_nan=False)
    after: Duration = 0.0
    duration: Duration | None = Field(default=None, alias="for")


class Fault(NamedTuple):
    """A fault of the board: its number, what it is, and from when to when (seconds of the board's clock)."""

    id: int
    spec: FaultSpec
    value: float
    begins: float
    ends: float

    def concerns(self, device: str, channel: str | None) -> bool:
        """Whether it acts on this channel of the device; `channel` None asks for the device as a whole."""
        if self.spec.device not in (None, device):
            return False
        return self.spec.channel is None or self.spec.channel == channel


def parse_spec(text: str) -> FaultSpec:
    """A fault from the command line: KIND[:DEVICE[/CHANNEL]][,value=V][,after=D][,for=D]; FaultError otherwise."""
    what, *settings = text.split(",")
    kind, _, where = what.partition(":")
    device, _, channel = where.partition("/")
    given: dict[str, Any] = {"kind": kind.strip(), "device": device.strip() or None, "channel": channel.strip() or None}
    for setting in settings:
        name, equals, value = (part.strip() for part in setting.partition("="))
        if not equals or name not in ("value", "after", "for"):
            raise FaultError(f'--fault {text}: "{setting}" must be value=..., after=... or for=..., as in {_EXAMPLE}')
        given[name] = value
    try:
        return FaultSpec.model_validate(given)
    except ValidationError as error:
        wrong = (f"{'.'.join(map(str, one['loc']))}: {own_sentence(one) or one['msg']}" for one in error.errors())
        raise FaultError(f"--fault {text}: {'; '.join(wrong)}") from None


_EXAMPLE = "drift:room1/T_air,value=0.5,after=10min,for=1h"


class FaultBoard:
    """The faults that act now or will; `clock` gives seconds that never jump."""

    def __init__(self, plant: Sequence[Device], clock: Callable[[], float]) -> None:
        self._devices = {device.name: device for device in plant}
        self._clock = clock
        self._faults: list[Fault] = []
        self._kept: dict[tuple[int, str, str], deque[tuple[float, float]]] = {}
        """By fault, device and channel, the values that a fault keeps back, each with its time."""
        self._ids = itertools.count(1)

    def add(self, spec: FaultSpec) -> Fault:
        """Switch a fault on, now or when its `after` has passed; FaultError says why the plant cannot have it."""
        kind = self._checked(spec)
        self._forget_ended()
        begins = self._clock() + spec.after
        ends = math.inf if spec.duration is None else begins + spec.duration
        value = spec.value if spec.value is not None else kind.default or 0.0
        fault = Fault(next(self._ids), spec, value, begins, ends)
        self._faults.append(fault)
        return fault

    def remove(self, number: int) -> bool:
        """Switch fault `number` off; whether there was one."""
        before = len(self._faults)
        self._faults = [fault for fault in self._faults if fault.id != number]
        self._kept = {key: values for key, values in self._kept.items() if key[0] != number}
        return len(self._faults) < before

    def clear(self) -> None:
        self._faults, self._kept = [], {}

    def listed(self) -> list[tuple[Fault, float]]:
        """Every fault that acts or will, with the seconds from now to its beginning (negative: it acts)."""
        self._forget_ended()
        now = self._clock()
        return [(fault, fault.begins - now) for fault in self._faults]

    def _forget_ended(self) -> None:
        now = self._clock()
        for fault in [fault for fault in self._faults if fault.ends <= now]:
            self.remove(fault.id)

    def active(self, kind: str, device: str, channel: str | None = None) -> Fault | None:
        """The fault of this kind that acts now on a channel, the newest if there are several."""
        return next(self._acting(kind, device, channel), None)

    def rooms(self, kind: str) -> dict[int, Fault]:
        """The rooms in which a fault of this kind acts now, by index, each with the newest."""
        if not any(fault.spec.kind == kind for fault in self._faults):
            return {}
        rooms = [(device.room, self.active(kind, device.name)) for device in self._devices.values()]
        return {room: fault for room, fault in rooms if room is not None and fault is not None}

    def on_request(self, kind: str, device: str, channels: Iterable[str]) -> list[Fault]:
        """The faults of this kind that act on a request which reads `channels` of the device."""
        return [fault for channel in (None, *channels) if (fault := self.active(kind, device, channel)) is not None]

    def falsified(self, device: str, channel: str, value: float) -> float:
        """What the sensor shows instead of `value`; NaN is "not available"."""
        if not self._faults:
            return value
        now = self._clock()
        for fault in self._acting("drift", device, channel):
            value += fault.value * (now - fault.begins) / 60.0
        value += sum(fault.value for fault in self._acting("offset", device, channel))
        value *= math.prod(fault.value for fault in self._acting("factor", device, channel))
        spikes = self._acting("spikes", device, channel)
        value += sum(fault.value for fault in spikes if (now - fault.begins) % 60.0 < SPIKE_SECONDS)
        for kind in ("late", "freeze"):
            if (withholding := self.active(kind, device, channel)) is not None:
                value = self._withheld(withholding, device, channel, value, now)
        if self.active("nan", device, channel):
            told = self._devices[device].channel(channel)
            if told is not None and told.register.can_be_unavailable:
                return math.nan
        return value

    def _withheld(self, fault: Fault, device: str, channel: str, value: float, now: float) -> float:
        """What is shown instead of `value` while the newest are kept back: the first one, or one of `late` s ago."""
        kept = self._kept.setdefault((fault.id, device, channel), deque([(now, value)]))
        if fault.spec.kind == "late":
            if value != kept[-1][1]:
                kept.append((now, value))
            while len(kept) > 1 and kept[1][0] <= now - fault.value:
                kept.popleft()
        return kept[0][1]

    def _acting(self, kind: str, device: str, channel: str | None) -> Iterator[Fault]:
        if not self._faults:
            return
        now = self._clock()
        for fault in reversed(self._faults):
            if fault.spec.kind == kind and fault.begins <= now < fault.ends and fault.concerns(device, channel):
                yield fault

    def _checked(self, spec: FaultSpec) -> Kind:
        kind = MENU.get(spec.kind)
        if kind is None:
            raise FaultError(f'there is no fault "{spec.kind}"; the menu is {", ".join(MENU)}')
        if spec.value is not None and not kind.value_unit:
            raise FaultError(f'"{spec.kind}" takes no value')
        if spec.value is not None and not kind.lowest <= spec.value <= kind.highest:
            raise FaultError(
                f'the value of "{spec.kind}" must be from {kind.lowest:g} to {kind.highest:g} ({kind.value_unit}), '
                f"not {spec.value:g}"
            )
        if spec.device is None:
            if spec.channel is not None:
                raise FaultError(f'channel "{spec.channel}" needs its device')
        elif spec.device not in self._devices:
            raise FaultError(f'there is no device "{spec.device}"; the devices are {", ".join(self._devices)}')
        else:
            self._check_place(spec, kind, self._devices[spec.device])
        return kind

    def _check_place(self, spec: FaultSpec, kind: Kind, device: Device) -> None:
        if kind.scope == "room" and device.room is None:
            raise FaultError(f'"{spec.kind}" happens in a room, and "{device.name}" is in none')
        if spec.channel is None:
            return
        if kind.scope in ("room", "clock"):
            raise FaultError(f'"{spec.kind}" concerns a device as a whole; leave the channel out')
        channel = device.channel(spec.channel)
        if channel is None:
            names = ", ".join(channel.name for channel in device.channels)
            raise FaultError(f'device "{device.name}" has no channel "{spec.channel}"; it has {names}')
        if spec.kind == "nan" and not channel.register.can_be_unavailable:
            raise FaultError(f"{device.name}/{channel.name} ({channel.register.type}) cannot say that it has no value")
        if spec.kind == "swapped-words" and channel.register.words == 1:
            raise FaultError(f"{device.name}/{channel.name} ({channel.register.type}) has one word only")
