"""When a sample is of: the time in its payload, Zenoh's, or that of its arrival."""

from __future__ import annotations

from dataclasses import dataclass

from adapters.messages.inbox import Incoming
from adapters.payload.payload import Decoded, Rejected
from adapters.reading import Fault
from adapters.timestamps import EARLIEST

TIMES = ("payload", "zenoh", "arrival")
"""Where the time of a reading can come from."""


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
