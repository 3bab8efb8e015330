"""What samples mean to the channels of a source: readings for the daemon, and probes for a person."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

from adapters.edge import PLAIN, Edge, LiveConverter
from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.payload.payload import Decoded, Payload, PayloadFormat, Rejected, decode, numbers_in, shown
from adapters.reading import Fault, Probe, Quality, Reading
from adapters.timestamps import EARLIEST

TIMES = ("payload", "zenoh", "arrival")
"""Where the time of a reading can come from."""

REPEAT = 600.0
"""What is wrong with the samples of a channel is said again after this time at the earliest, in s."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MessageChannel:
    """Which key expression or topic brings the raw values of channel `id` ("zone/channel"), how they are written, and
    what becomes of them. A raw value that has not changed for `stuck_after` s is uncertain, for twice as long bad."""

    id: str
    key: str
    format: PayloadFormat = field(default_factory=PayloadFormat)
    edge: Edge = PLAIN
    stuck_after: float | None = None


@dataclass(frozen=True)
class Dating:
    """How readings are dated: the first of `times` (some of TIMES) that a sample has. A time more than `max_ahead` s
    ahead of this machine's clock is refused."""

    times: tuple[str, ...] = TIMES
    max_ahead: float = 10.0

    def date(self, decoded: Decoded, incoming: Incoming) -> tuple[float, str] | Rejected:
        """The time in UTC s and where it comes from: for one that the payload counts from the arrival, that is the
        arrival, which a message that was kept or that waited does not tell right."""
        absolute = {
            "payload": None if decoded.relative else decoded.time,
            "zenoh": incoming.stamp,
            "arrival": incoming.arrived,
        }
        for name in self.times:
            when, origin = absolute[name], name
            if name == "payload" and decoded.relative and decoded.time is not None:
                when = decoded.time + (incoming.arrived if incoming.stamp is None else incoming.stamp)
                origin = "arrival" if incoming.stamp is None else name
            if when is None:
                continue
            if when > incoming.arrived + self.max_ahead:
                sentence = (
                    f"is dated {when - incoming.arrived:.0f} s ahead of this machine's clock; look at both clocks"
                )
                return Rejected(Fault.AHEAD_OF_TIME, sentence)
            if when < EARLIEST:
                return Rejected(Fault.BAD_TIMESTAMP, "is dated before 1970; look at time_format")
            return when, origin
        return Rejected(Fault.BAD_TIMESTAMP, f"has no time of any kind in times ({', '.join(self.times)})")


class _Watched:
    """A channel, and what has to be remembered of its last values."""

    def __init__(self, channel: MessageChannel, longest_stretch: float, noun: str) -> None:
        self.channel = channel
        self._noun = noun
        self.converter = LiveConverter(channel.id, channel.edge, longest_stretch, channel.stuck_after)
        self.newest = float("-inf")
        """Time of the newest value so far, UTC s."""
        self.known_until = float("-inf")
        """What is not newer was had before the session was opened anew, UTC s."""
        self.heard = False
        self._said: dict[Fault, float] = {}

    def forget_after(self, arrived: float) -> None:
        """Forget what was had if it is dated after `arrived` (UTC s), the time of arrival of a new sample.

        The clock that dated it was wrong and has been set back. Until it catches up, everything new would pass for
        something that was had.
        """
        if self.known_until > arrived:
            self.known_until = float("-inf")

    def say(self, rejected: Rejected, key: str) -> None:
        """Log what is wrong, now and then."""
        now = time.monotonic()
        if now >= self._said.get(rejected.fault, float("-inf")):
            self._said[rejected.fault] = now + REPEAT
            _log.warning("%s (%s %s): the payload %s", self.channel.id, self._noun, key, rejected.sentence)


class Channels:
    """The channels of a source by their key expressions or topics."""

    def __init__(
        self, channels: Sequence[MessageChannel], dating: Dating, longest_stretch: float, noun: str = "key"
    ) -> None:
        """`longest_stretch`: no power is made of counts that lie further apart, in s. `noun`: what `key` is called
        where samples come from."""
        self._dating, self._longest_stretch, self._noun = dating, longest_stretch, noun
        self._at: dict[str, list[_Watched]] = {}
        self.replace(channels)

    def replace(self, channels: Sequence[MessageChannel]) -> None:
        """These are the channels from now on; what is remembered of those that stay is kept."""
        known = {watched.channel: watched for watched in self._all()}
        self._at = {}
        for channel in channels:
            watched = known.get(channel) or _Watched(channel, self._longest_stretch, self._noun)
            self._at.setdefault(channel.key, []).append(watched)

    @property
    def keys(self) -> list[str]:
        """Every key expression, once."""
        return list(self._at)

    def start_again(self) -> None:
        """The session is a new one: what it recovers may have been had already."""
        for watched in self._all():
            watched.known_until, watched.heard = watched.newest, False

    def unheard(self) -> list[str]:
        """The channels on whose keys nothing has come since `start_again`, each with its key."""
        quiet = [watched.channel for watched in self._all() if not watched.heard]
        return [f"{channel.id} ({self._noun} {channel.key})" for channel in quiet]

    def readings(self, key: str, samples: Sequence[Incoming]) -> Iterator[Reading]:
        """The readings that `samples` of the subscription to `key` bring."""
        for incoming in samples:
            payload = None if incoming.payload is None else Payload(incoming.payload)
            for watched in self._at[key]:
                watched.heard = True
                yield from self._read(watched, incoming, payload)

    def overrun(self, key: str, now: float) -> Iterator[Reading]:
        """Bad readings that say that older samples of `key` had to be dropped."""
        return (watched.converter.bad(now, Fault.OVERRUN) for watched in self._at[key])

    def _all(self) -> Iterator[_Watched]:
        return (watched for listed in self._at.values() for watched in listed)

    def _read(self, watched: _Watched, incoming: Incoming, payload: Payload | None) -> Iterator[Reading]:
        watched.forget_after(incoming.arrived)
        latest = incoming.arrived + self._dating.max_ahead
        for when, entry, origin in _dated(watched.channel.format, self._dating, incoming, payload):
            if isinstance(entry, Rejected):
                watched.say(entry, incoming.key)
                yield watched.converter.bad(when, entry.fault)
            elif when > watched.known_until:
                if incoming.retained and origin == "arrival":
                    if watched.newest > float("-inf") or watched.channel.edge.counter:
                        # It may be years old: what came since is newer, and power is made of known times alone.
                        continue
                    entry = entry._replace(quality=Quality.UNCERTAIN)
                else:
                    # A time that would be refused by now comes from a clock that has been set back since.
                    watched.newest = when if watched.newest > latest else max(watched.newest, when)
                reading = watched.converter.reading(when, entry.raw, entry.quality)
                if reading is not None:
                    yield reading


def _entries(form: PayloadFormat, incoming: Incoming, payload: Payload | None) -> list[Decoded | Rejected]:
    if payload is not None:
        return decode(payload, form, incoming.arrived)
    if incoming.size:
        sentence = f"has {incoming.size} bytes; at most {LONGEST_PAYLOAD} are looked at"
        return [Rejected(Fault.NON_NUMERIC, sentence)]
    return [Rejected(Fault.NOT_AVAILABLE, "is gone: the publisher has deleted the key")]


def _dated(
    form: PayloadFormat, dating: Dating, incoming: Incoming, payload: Payload | None
) -> list[tuple[float, Decoded | Rejected, str]]:
    """What `incoming` says in the order of its times (UTC s), with their origin; what is refused is dated when it
    came."""
    dated: list[tuple[float, Decoded | Rejected, str]] = []
    for entry in _entries(form, incoming, payload):
        when = entry if isinstance(entry, Rejected) else dating.date(entry, incoming)
        dated.append((incoming.arrived, when, "arrival") if isinstance(when, Rejected) else (when[0], entry, when[1]))
    # Nobody has measured what is to come: the publisher's clock is ahead, for all that it sends together.
    ahead = max((when - incoming.arrived for when, _, _ in dated), default=0.0)
    if ahead > 0:
        dated = [(when if isinstance(entry, Rejected) else when - ahead, entry, by) for when, entry, by in dated]
    return sorted(dated, key=lambda found: found[0])


def probed(channel: MessageChannel, dating: Dating, samples: Sequence[Incoming], nothing: str) -> Probe:
    """What a person should know about the `samples` that came for `channel`; `nothing` is the verdict without any."""
    place = f"{channel.key} {channel.format.kind}"
    if not samples:
        return Probe(channel.id, place, "-", None, None, nothing)
    incoming = max(samples, key=lambda sample: sample.stamp or sample.arrived)
    raw = shown(incoming.payload or b"")
    payload = None if incoming.payload is None else Payload(incoming.payload)
    entries = _entries(channel.format, incoming, payload)
    decoded = next((entry for entry in reversed(entries) if isinstance(entry, Decoded)), None)
    dated = decoded and dating.date(decoded, incoming)
    refused = next((entry for entry in (*entries, dated) if isinstance(entry, Rejected)), None)
    if refused is not None or decoded is None or dated is None or isinstance(dated, Rejected):
        sentence = "holds nothing" if refused is None else refused.sentence
        hints = _numbers(channel, incoming)
        return Probe(channel.id, place, raw, None, None, f"refused: the payload {sentence}", tuple(hints))
    when, origin = dated
    moment = datetime.fromtimestamp(when, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    hints = [f"dated {moment} by {_ORIGINS[origin]}"]
    ageless = incoming.retained and origin == "arrival"
    if ageless:
        hints = ["retained: the broker had kept it, and its age is not known"]
    known = None if ageless else when
    if channel.edge.counter:
        hints.append(f"the counter stands at {decoded.raw * channel.edge.scale + channel.edge.offset:g}")
        return Probe(channel.id, place, raw, None, known, hints=tuple(hints))
    value = channel.edge.value(decoded.raw)
    verdict = channel.edge.doubt(value)
    if verdict is not None:
        hints += _numbers(channel, incoming)
    elif decoded.quality is not Quality.GOOD:
        verdict = "uncertain: its quality says so, or is missing"
    else:
        verdict = "good"
    return Probe(channel.id, place, raw, value, known, verdict, tuple(hints))


_ORIGINS = {"payload": "its payload", "zenoh": "Zenoh's time stamp", "arrival": "its arrival"}


def _numbers(channel: MessageChannel, incoming: Incoming) -> list[str]:
    """What else of a document might be meant."""
    numbers = numbers_in(incoming.payload or b"") if channel.format.kind == "json" else []
    return [f"numbers in it: {', '.join(f'{pointer} {number:g}' for pointer, number in numbers)}"] if numbers else []
