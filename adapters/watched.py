"""Channels of a live source at work: what is remembered of them, and what the values that come mean to them."""

import logging
import time
from collections.abc import AsyncIterator, Callable, Hashable, Iterable, Sequence
from contextlib import asynccontextmanager
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from adapters.channel import Binding
from adapters.edge import LiveConverter, looked_at
from adapters.errors import SourceConfigError, said_of
from adapters.reading import Fault, Probe, Quality, Reading, Source

POLLS_IN_A_STRETCH = 10
"""Counts that lie further apart than so many polls make no power: what was used meanwhile is not what is used now."""

REPEAT = 600.0
"""What is wrong with what comes is said again after this time at the earliest, in s."""

_log = logging.getLogger(__name__)


class Seldom:
    """Whether it is time to say something, by what it is about: at once, and again after REPEAT s."""

    def __init__(self) -> None:
        self._next: dict[Hashable, float] = {}

    def __call__(self, about: Hashable) -> bool:
        now = time.monotonic()
        if now < self._next.get(about, now):
            return False
        self._next[about] = now + REPEAT
        return True


class Verdict(NamedTuple):
    """The number in what was found, and how far it can be believed, with the sentence for a person."""

    raw: float | None
    quality: Quality = Quality.GOOD
    fault: Fault | None = None
    sentence: str = "good"


class Watched:
    """A channel of a live source at work, with what has to be remembered of its last values.

    `point` is where its raw value is found, `place` the same in the operator's words.
    """

    point: Any

    def __init__(self, binding: Binding, longest_stretch: float, rollover: float | None = None) -> None:
        """`longest_stretch`: no power is made of counts that lie further apart, in s."""
        self.binding, self.id = binding, binding.id
        self.place: str = binding.channel.address
        self.edge = binding.edge(rollover)
        self.converter = LiveConverter(binding.id, self.edge, longest_stretch, binding.channel.stuck_after)

    def read(self, verdict: Verdict, when: float, sent: Hashable = None) -> Reading | None:
        """The reading that `verdict` brings at `when` (UTC s), of which `sent` is what was sent; None for the first one
        of a counter."""
        if verdict.fault is not None or verdict.raw is None:
            return self.converter.bad(when, verdict.fault or Fault.NOT_AVAILABLE)
        return self.converter.reading(when, verdict.raw, verdict.quality, sent)

    def probed(self, verdict: Verdict, shown: str, when: float | None, hints: Sequence[str] = ()) -> Probe:
        """What a person should know about `verdict` at `when` (UTC s); `shown` is the raw value as people write it."""
        if verdict.raw is None or verdict.fault is not None:
            return Probe(self.id, self.place, shown, None, when, verdict.sentence, tuple(hints))
        return looked_at(self.id, self.place, self.edge, verdict.raw, when, shown, verdict.sentence, hints)


AtWork = TypeVar("AtWork", bound=Watched)


def put_to_work(
    bindings: Iterable[Binding], before: Iterable[AtWork], begin: Callable[[Binding], AtWork]
) -> list[AtWork]:
    """`bindings` at work: those that were so `before` go on with what they remember, the others `begin`."""
    known = {one.id: one for one in before}
    return [
        one if (one := known.get(binding.id)) is not None and one.binding.reads_like(binding) else begin(binding)
        for binding in bindings
    ]


class Channels(Generic[AtWork]):
    """The channels of the source called `name`, by the points that bring their values."""

    def __init__(self, name: str, bindings: Iterable[Binding], begin: Callable[[Binding], AtWork]) -> None:
        self._name, self._begin = name, begin
        self._at: dict[Hashable, list[AtWork]] = {}
        self._refused: dict[Hashable, str] = {}
        """Points whose refusal was said, and the verb that said it."""
        self.replace(bindings)

    def replace(self, bindings: Iterable[Binding]) -> None:
        """These are the channels from now on; what is remembered of those that stay is kept."""
        at_work = put_to_work(bindings, self.all(), self._begin)
        self._at = {}
        for channel in at_work:
            self._at.setdefault(channel.point, []).append(channel)
        self._refused = {point: verb for point, verb in self._refused.items() if point in self._at}

    @property
    def points(self) -> list[Any]:
        """Where values are found, each once."""
        return list(self._at)

    def all(self) -> list[AtWork]:
        """All of them."""
        return [channel for at_point in self._at.values() for channel in at_point]

    def at(self, point: Hashable) -> Sequence[AtWork]:
        """The channels whose raw value is found at `point`."""
        return self._at.get(point, ())

    def readings(
        self, point: Hashable, judged: Callable[[AtWork], Verdict], when: float, sent: Hashable = None
    ) -> list[Reading]:
        """The readings of the channels of `point` at `when` (UTC s), where `sent` was sent, as each has `judged` it."""
        found = (channel.read(judged(channel), when, sent) for channel in self.at(point))
        return [reading for reading in found if reading is not None]

    def bad(self, point: Hashable, fault: Fault) -> list[Reading]:
        """Bad readings of the channels of `point`, now."""
        return [channel.converter.bad(time.time(), fault) for channel in self.at(point)]

    def names(self, point: Hashable) -> str:
        """The channels of `point` and where that is, for the log."""
        at_point = self._at[point]
        return f"{', '.join(channel.id for channel in at_point)} ({at_point[0].place})"

    def note_refusal(self, point: Hashable, reason: str, again: str, verb: str = "refuses") -> None:
        """Log that the device refuses `point`, once, and when it is asked `again`."""
        if self._refused.get(point) != verb:
            self._refused[point] = verb
            say = "sources.%s: the device %s %s: %s; asking again %s"
            _log.error(say, self._name, verb, self.names(point), reason, again)

    def note_value(self, point: Hashable) -> None:
        """Log that a point that was refused has a value again."""
        if self._refused.pop(point, None) is not None:
            _log.info("sources.%s: the device gives %s again", self._name, self.names(point))


class Link(Protocol):
    """The connection of a live source."""

    async def open(self) -> None:
        """Connect. Raises SourceError."""
        ...

    async def close(self) -> None:
        """Disconnect; safe to call twice, and when it was never open."""
        ...


AnyLink = TypeVar("AnyLink", bound=Link)


class LiveSource(Source):
    """What every live source does with its connection, and with channels that change while it is at work."""

    def __init__(self, name: str, bindings: Sequence[Binding]) -> None:
        self.name = name
        self._listed, self._rebound = tuple(bindings), False
        """The channels that are wanted, and whether they have changed since they were taken up."""
        self._link: Any = None

    def rebind(self, bindings: Sequence[Binding]) -> None:
        """Deliver `bindings` from the next look on, over the same connection."""
        self._listed, self._rebound = tuple(bindings), True

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
        if self._link is not None:
            await self._link.close()

    @asynccontextmanager
    async def _opened(self, make: Callable[[], AnyLink]) -> AsyncIterator[AnyLink]:
        """The link that `make` makes, open; its errors begin with the name of the source. Raises SourceConfigError for
        what `check` finds."""
        for problem in self.check():
            raise SourceConfigError(problem)
        with said_of(self.name):
            self._link = link = make()
            try:
                await link.open()
                yield link
            finally:
                await link.close()
