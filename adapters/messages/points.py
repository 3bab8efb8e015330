"""What samples mean to the channels of a source: readings for the daemon, and probes for a person."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence

from adapters.channel import Binding
from adapters.edge import looked_at
from adapters.fields.times import written_to_the_millisecond
from adapters.messages.dating import Dating
from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.payload.payload import Decoded, Payload, PayloadFormat, Rejected, decode, numbers_in, shown
from adapters.reading import Fault, Probe, Quality, Reading
from adapters.watched import Channels, Seldom, Watched

_log = logging.getLogger(__name__)


class MessageChannel(Watched):
    """A channel of a source, by the key expression or topic that brings its raw values."""

    def __init__(self, binding: Binding, longest_stretch: float) -> None:
        super().__init__(binding, longest_stretch)
        self.point: str = binding.channel.place
        self.format: PayloadFormat = binding.channel.payload_format
        self.newest = float("-inf")
        """Time of the newest value so far, UTC s."""
        self.known_until = float("-inf")
        """What is not newer was had before the session was opened anew, UTC s."""
        self.heard = False
        self._seldom = Seldom()

    def forget_after(self, arrived: float) -> None:
        """Forget what was had if it is dated after `arrived` (UTC s), the time of arrival of a new sample.

        The clock that dated it was wrong and has been set back. Until it catches up, everything new would pass for
        something that was had.
        """
        if self.known_until > arrived:
            self.known_until = float("-inf")

    def say(self, rejected: Rejected, place: str) -> None:
        """Log what is wrong with what came at `place`, now and then."""
        if self._seldom(rejected.fault):
            _log.warning("%s (%s): the payload %s", self.id, place, rejected.sentence)


class MessageChannels(Channels[MessageChannel]):
    """The channels of a source by their key expressions or topics."""

    def __init__(
        self, name: str, bindings: Iterable[Binding], dating: Dating, longest_stretch: float, noun: str = "key"
    ) -> None:
        """`longest_stretch`: no power is made of counts that lie further apart, in s. `noun`: what a key is called
        where samples come from."""
        super().__init__(name, bindings, lambda one: MessageChannel(one, longest_stretch))
        self._dating, self._noun = dating, noun

    def start_again(self) -> None:
        """The session is a new one: what it recovers may have been had already."""
        for channel in self.all():
            channel.known_until, channel.heard = channel.newest, False

    def unheard(self) -> list[str]:
        """The channels on whose keys nothing has come since `start_again`, each with its key."""
        return [f"{channel.id} ({self._noun} {channel.point})" for channel in self.all() if not channel.heard]

    def came(self, key: str, samples: Sequence[Incoming]) -> Iterator[Reading]:
        """The readings that `samples` of the subscription to `key` bring."""
        for incoming in samples:
            payload = None if incoming.payload is None else Payload(incoming.payload)
            for channel in self.at(key):
                channel.heard = True
                yield from self._read(channel, incoming, payload)

    def _read(self, channel: MessageChannel, incoming: Incoming, payload: Payload | None) -> Iterator[Reading]:
        channel.forget_after(incoming.arrived)
        latest = incoming.arrived + self._dating.max_ahead
        for when, entry, origin in _dated(channel.format, self._dating, incoming, payload):
            if isinstance(entry, Rejected):
                channel.say(entry, f"{self._noun} {incoming.key}")
                yield channel.converter.bad(when, entry.fault)
            elif when > channel.known_until:
                if incoming.retained and origin == "arrival":
                    if channel.newest > float("-inf") or channel.edge.counter:
                        # It may be years old: what came since is newer, and power is made of known times alone.
                        continue
                    entry = entry._replace(quality=Quality.UNCERTAIN)
                else:
                    # A time that would be refused by now comes from a clock that has been set back since.
                    channel.newest = when if channel.newest > latest else max(channel.newest, when)
                reading = channel.converter.reading(when, entry.raw, entry.quality)
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
    place = f"{channel.point} {channel.format.kind}"
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
    hints = [f"dated {written_to_the_millisecond(when)} by {_ORIGINS[origin]}"]
    ageless = incoming.retained and origin == "arrival"
    if ageless:
        hints = ["retained: the broker had kept it, and its age is not known"]
    known = None if ageless else when
    good = decoded.quality is Quality.GOOD
    verdict = "good" if good else "uncertain: its quality says so, or is missing"
    found = looked_at(channel.id, place, channel.edge, decoded.raw, known, raw, verdict, hints)
    return found if found.verdict == verdict else found._replace(hints=(*hints, *_numbers(channel, incoming)))


_ORIGINS = {"payload": "its payload", "zenoh": "Zenoh's time stamp", "arrival": "its arrival"}


def _numbers(channel: MessageChannel, incoming: Incoming) -> list[str]:
    """What else of a document might be meant."""
    numbers = numbers_in(incoming.payload or b"") if channel.format.kind == "json" else []
    return [f"numbers in it: {', '.join(f'{pointer} {number:g}' for pointer, number in numbers)}"] if numbers else []
