"""What every source delivers: readings, in batches, with the source's own clock."""

from collections.abc import AsyncIterator
from enum import StrEnum
from typing import NamedTuple, Protocol


class Quality(StrEnum):
    """How far a reading can be believed."""

    GOOD = "good"
    UNCERTAIN = "uncertain"
    BAD = "bad"


class Fault(StrEnum):
    """Why a reading is bad; counted by kind for every zone."""

    NON_NUMERIC = "non_numeric"
    NOT_FINITE = "not_finite"
    OUT_OF_RANGE = "out_of_range"
    OUT_OF_ORDER = "out_of_order"
    DUPLICATED = "duplicated"
    NOT_AVAILABLE = "not_available"
    STUCK = "stuck"
    COUNTER_RESET = "counter_reset"
    REFUSED_BY_DEVICE = "refused_by_device"
    REPORTED_BAD = "reported_bad"
    WRONG_UNIT = "wrong_unit"
    OVERRUN = "overrun"
    NAIVE_TIMESTAMP = "naive_timestamp"
    BAD_TIMESTAMP = "bad_timestamp"
    AHEAD_OF_TIME = "ahead_of_time"


class Reading(NamedTuple):
    """One value of the channel with this id ("zone/channel"). `time` is UTC s (NaN if the timestamp was refused),
    `value` in the network's unit (NaN when bad). A missing cell is no reading at all."""

    channel: str
    time: float
    value: float
    quality: Quality = Quality.GOOD
    fault: Fault | None = None


class Batch(NamedTuple):
    """Readings that arrived together; those up to the source's clock `now` (UTC s) were delivered; -inf: unknown."""

    readings: list[Reading]
    now: float


class Probe(NamedTuple):
    """What one look at a channel found, for a person: where (`place`) and what (`raw`), `value` in the network's unit
    and `time` (UTC s) if any, a `verdict`, "good" or a sentence, and `hints` at what might be meant."""

    channel: str
    place: str
    raw: str
    value: float | None
    time: float | None
    verdict: str = "good"
    hints: tuple[str, ...] = ()


class Source(Protocol):
    """A source of readings. One object per `[sources.<name>]` table."""

    name: str

    def check(self) -> list[str]:
        """What is wrong with it, one sentence each, as far as that can be told without connecting to anything."""
        return []

    def batches(self, start: float | None) -> AsyncIterator[Batch]:
        """Deliver batches in order: a recorded source from UTC s `start` (None: its beginning) to its end, a live one
        from now on. Raises SourceUnavailable for what may pass, after which it may be called again, and
        SourceConfigError."""
        ...

    async def probe(self, seconds: float) -> list[Probe]:
        """Look at every channel once, in order, or for `seconds` where it tells by itself. Raises SourceUnavailable."""
        ...

    async def close(self) -> None:
        """Release what the source holds, if anything; safe to call twice."""
        return
