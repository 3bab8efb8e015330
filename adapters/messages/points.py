"""What samples mean to the channels of a source: readings for the daemon, and probes for a person."""

import logging
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from adapters.channel import Binding
from adapters.edge import looked_at
from adapters.fields.times import written_to_the_millisecond
from adapters.messages.config import MessageChannelConfig, MessagesConfig
from adapters.messages.decoding import Decoded, Payload, Rejected, decode, numbers_in, shown
from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.reading import Fault, Probe, Quality, Reading
from adapters.timestamps import EARLIEST
from adapters.watched import Channels, Seldom, Watched

_log = logging.getLogger(__name__)

_NEVER = float("-inf")
_ORIGINS = {"payload": "its payload", "zenoh": "Zenoh's time stamp", "arrival": "its arrival"}

Dated = tuple[float, str, Decoded | Rejected]
"""A time (UTC s), where it comes from, and what is of that time."""


class MessageChannel(Watched):
    """A channel of a source, by the key expression or topic that brings its raw values."""

    def __init__(self, binding: Binding, table: Any) -> None:
        super().__init__(binding, table.longest_stretch)
        self.form: MessageChannelConfig = binding.channel
        self.point = self.form.place
        self.place = f"{self.point} {self.form.format}"
        self.newest = _NEVER
        """Time of the newest value so far, UTC s."""
        self.known_until = _NEVER
        """What is not newer was had before the session was opened anew, UTC s."""
        self.heard = False
        self._table, self._seldom = table, Seldom()

    def read_all(self, incoming: Incoming, payload: Payload | None) -> Iterator[Reading]:
        self.heard = True
        if self.known_until > incoming.arrived:
            # The clock that dated it was wrong and has been set back. Until it catches up, everything new would pass
            # for something that was had.
            self.known_until = _NEVER
        latest = incoming.arrived + self._table.max_ahead
        for when, origin, entry in self._dated(incoming, payload):
            if isinstance(entry, Rejected):
                if self._seldom(entry.fault):
                    say = "%s (%s %s): the payload %s"
                    _log.warning(say, self.id, self.form.noun, incoming.key, entry.sentence)
                yield self.converter.bad(when, entry.fault)
            elif when > self.known_until:
                quality = entry.quality
                if incoming.retained and origin == "arrival":
                    if self.newest > _NEVER or self.edge.counter:
                        # It may be years old: what came since is newer, and power is made of known times alone.
                        continue
                    quality = Quality.UNCERTAIN
                else:
                    # A time that would be refused by now comes from a clock that has been set back since.
                    self.newest = when if self.newest > latest else max(self.newest, when)
                reading = self.converter.reading(when, entry.raw, quality)
                if reading is not None:
                    yield reading

    def look(self, samples: Sequence[Incoming], nothing: str) -> Probe:
        """What a person should know about the `samples` that came; `nothing` is the verdict without any."""
        if not samples:
            return Probe(self.id, self.place, "-", None, None, nothing)
        incoming = max(samples, key=lambda sample: sample.stamp or sample.arrived)
        content = incoming.payload or b""
        numbers = numbers_in(content) if self.form.format == "json" else []
        listed = ", ".join(f"{pointer} {number:g}" for pointer, number in numbers)
        others = [f"numbers in it: {listed}"] if numbers else []
        entries = self._entries(incoming, None if incoming.payload is None else Payload(content))
        decoded = next((entry for entry in reversed(entries) if isinstance(entry, Decoded)), None)
        dated = decoded and self._date(decoded, incoming)
        refused = next((entry for entry in (*entries, dated) if isinstance(entry, Rejected)), None)
        if refused is not None or decoded is None or dated is None or isinstance(dated, Rejected):
            sentence = "holds nothing" if refused is None else refused.sentence
            verdict = f"refused: the payload {sentence}"
            return Probe(self.id, self.place, shown(content), None, None, verdict, tuple(others))
        when, origin = dated
        ageless = incoming.retained and origin == "arrival"
        hint = f"dated {written_to_the_millisecond(when)} by {_ORIGINS[origin]}"
        hints = ["retained: the broker had kept it, and its age is not known" if ageless else hint]
        good = decoded.quality is Quality.GOOD
        verdict = "good" if good else "uncertain: its quality says so, or is missing"
        known = None if ageless else when
        found = looked_at(self.id, self.place, self.edge, decoded.raw, known, shown(content), verdict, hints)
        return found if found.verdict == verdict else found._replace(hints=(*hints, *others))

    def _entries(self, incoming: Incoming, payload: Payload | None) -> list[Decoded | Rejected]:
        if payload is not None:
            return decode(payload, self.form, incoming.arrived)
        if incoming.size:
            sentence = f"has {incoming.size} bytes; at most {LONGEST_PAYLOAD} are looked at"
            return [Rejected(Fault.NON_NUMERIC, sentence)]
        return [Rejected(Fault.NOT_AVAILABLE, "is gone: the publisher has deleted the key")]

    def _dated(self, incoming: Incoming, payload: Payload | None) -> list[Dated]:
        """What `incoming` says in the order of its times; what is refused is dated when it came."""
        found: list[Dated] = []
        for entry in self._entries(incoming, payload):
            when = entry if isinstance(entry, Rejected) else self._date(entry, incoming)
            found.append((incoming.arrived, "arrival", when) if isinstance(when, Rejected) else (*when, entry))
        # Nobody has measured what is to come: the publisher's clock is ahead, for all that it sends together.
        ahead = max((when - incoming.arrived for when, _, _ in found), default=0.0)
        if ahead > 0:
            found = [(when if isinstance(entry, Rejected) else when - ahead, by, entry) for when, by, entry in found]
        return sorted(found, key=lambda dated: dated[0])

    def _date(self, decoded: Decoded, incoming: Incoming) -> tuple[float, str] | Rejected:
        """The time in UTC s and where it comes from: the first of the `times` of the table that the sample has, refused
        where it is more than `max_ahead` s ahead of this machine's clock. One that the payload counts from the arrival
        comes from the arrival, which is not known of a message that was kept or waited."""
        absolute = {"payload": decoded.time, "zenoh": incoming.stamp, "arrival": incoming.arrived}
        for name in self._table.times:
            when, origin = absolute[name], name
            if when is None:
                continue
            if name == "payload" and decoded.relative:
                when += incoming.arrived if incoming.stamp is None else incoming.stamp
                origin = "arrival" if incoming.stamp is None else name
            if when > incoming.arrived + self._table.max_ahead:
                sentence = (
                    f"is dated {when - incoming.arrived:.0f} s ahead of this machine's clock; look at both clocks"
                )
                return Rejected(Fault.AHEAD_OF_TIME, sentence)
            if when < EARLIEST:
                return Rejected(Fault.BAD_TIMESTAMP, "is dated before 1970; look at time_format")
            return when, origin
        return Rejected(Fault.BAD_TIMESTAMP, f"has no time of any kind in times ({', '.join(self._table.times)})")


class MessageChannels(Channels[MessageChannel]):
    """The channels of a source by their key expressions or topics."""

    def __init__(self, name: str, bindings: Iterable[Binding], table: MessagesConfig) -> None:
        super().__init__(name, bindings, lambda one: MessageChannel(one, table))

    def start_again(self) -> None:
        for channel in self.all():
            channel.known_until, channel.heard = channel.newest, False

    def came(self, key: str, incoming: Incoming) -> Iterator[Reading]:
        payload = None if incoming.payload is None else Payload(incoming.payload)
        for channel in self.at(key):
            yield from channel.read_all(incoming, payload)
