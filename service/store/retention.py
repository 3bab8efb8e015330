"""What the journal keeps: `keep_history` of every zone, within `max_journal` in all, and the samples of a zone after
its oldest checkpoint in any case, which a start may need. Age counts from a zone's newest sample, so that a recording
of another year is not old by itself. After a leap in time, which is an outage or a clock that was set wrong, nothing
counts as old until a day of samples has followed, nor until a day has gone by since the clock of this machine was set;
and what goes at once is a week at most, which the log tells."""

import logging
import math
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from adapters.fields.times import written_time
from service.store.audit import AUDIT, about
from service.store.journal import ROWS, Journal, is_aside

HOUR = 3600
DAY = 24 * HOUR
LEAP = 2 * DAY
"""Two samples of a zone further apart than this, in s, are a leap."""
STEADY_HOURS = 24
"""After a leap, samples of so many hours make the time of the newest one count again."""
MOST_AT_ONCE = 7 * DAY
"""How much of a zone's time is deleted for its age between two looks, in s."""
SET = HOUR
"""s by which the wall clock differs from one that nobody sets, where it was set."""
_BEGIN = 0.95
"""From which part of the limit on there is shrinking, so that the limit itself is not reached between two looks."""
_TOLD = 5
_ALWAYS = 2**62
"""Later than every sample."""
FOREVER = float(_ALWAYS)
"""A `keep_history` for which nothing is too old."""

_log = logging.getLogger(__name__)

Oldest = Callable[[str], int | None]


class Limits(NamedTuple):
    """`keep_history` in s of a zone's own time, `max_journal` in bytes."""

    keep_history: float
    max_journal: float


class Stable:
    """Whether the clock of this machine has not been set for a day, as far as this process knows: a clock that is led
    on in small steps would make a day of samples in minutes."""

    def __init__(
        self,
        wall: Callable[[], float] = time.time,
        steady: Callable[[], float] = lambda: time.clock_gettime(time.CLOCK_BOOTTIME),
    ) -> None:
        """`wall` and `steady` give UTC s, and s on a clock that is never set and goes on while the machine sleeps."""
        self._wall, self._steady = wall, steady
        self._beside, self._until = wall() - steady(), -math.inf

    def __call__(self) -> bool:
        now = self._steady()
        moved = self._wall() - now - self._beside
        if abs(moved) > SET:
            self._beside, self._until = self._beside + moved, now + DAY
            _log.warning("the clock was set by %+.0f s: for a day no history is deleted for its age", moved)
        return now >= self._until


def prune(journal: Journal, oldest_checkpoint: Oldest, limits: Limits) -> Iterator[None]:
    """Delete what is older than `keep_history`, and the oldest rows of all while the file is too large: a small slice
    at every step of the iterator, so that samples come in between.

    `oldest_checkpoint` tells the time of the oldest checkpoint of a zone, None if there is none.
    """
    told: list[str] = []
    for zone in journal.prunable():
        newest = journal.last_sample_time(zone)
        if newest is not None:
            before = math.ceil(newest - limits.keep_history)
            firsts = [_first(journal, table, zone) for table in ("samples", "history")]
            if before > min(firsts) + journal.database.least_pruned and _is_steady(journal, zone, newest):
                samples, history = (min(before, first + MOST_AT_ONCE) for first in firsts)
                while journal.delete(zone, min(samples, _needed(zone, newest, oldest_checkpoint)), history):
                    yield
                if history - firsts[1] > DAY:
                    told.append(f"'{zone}' from {written_time(firsts[1])} to {written_time(history)}")
        yield
    if told:
        more = f", and of {len(told) - _TOLD} more zones" if len(told) > _TOLD else ""
        sentence = "history older than keep_history is deleted: of zone %s%s"
        AUDIT.warning(sentence, ", ".join(told[:_TOLD]), more, extra=about("deleted", "keep_history"))
    if journal.database.shrink() is None:
        # Deleting more would not make the files smaller.
        return
    while journal.database.size() > _BEGIN * limits.max_journal:
        victim = _oldest_zone(journal, oldest_checkpoint)
        if victim is None or not journal.delete(*victim):
            break
        journal.database.shrink()
        yield
    while journal.database.shrink():
        yield
    # Only with this does the file end where its pages do.
    journal.read("PRAGMA wal_checkpoint(PASSIVE)")


def _is_steady(journal: Journal, zone: str, newest: int) -> bool:
    """Whether the samples before the one at `newest` (s) lead up to it without a leap, for STEADY_HOURS of them."""
    time = newest
    for _ in range(STEADY_HOURS):
        earlier = journal.sample_time_until(zone, time - HOUR)
        if earlier is None:
            return True
        if time - earlier > LEAP:
            return False
        time = earlier
    return True


def _first(journal: Journal, table: str, zone: str) -> int:
    """The time of the oldest row of `zone` in a table; later than every sample if there is none."""
    first = journal.first_time(table, zone)
    return _ALWAYS if first is None else first


def _needed(zone: str, newest: int, oldest_checkpoint: Oldest) -> int:
    """The time from which on the samples of `zone` stay: what follows its oldest checkpoint, and its newest one."""
    oldest = oldest_checkpoint(zone)
    return -_ALWAYS if oldest is None else min(oldest + 1, newest)


def _oldest_zone(journal: Journal, oldest_checkpoint: Oldest) -> tuple[str, int, int] | None:
    """The arguments of `delete` for the zone with the oldest row, first of what was set aside; or None."""
    found: list[tuple[bool, float, str, int]] = []
    for zone in journal.every_zone():
        newest = journal.last_sample_time(zone)
        aside = is_aside(zone)
        before = _ALWAYS if aside or newest is None else _needed(zone, newest, oldest_checkpoint)
        for table in ROWS:
            if table == "readings" and not aside:
                # Those of a zone that is at work go with its samples.
                continue
            first = _first(journal, table, zone)
            if first < before:
                found.append((not aside, first, zone, before))
    if not found:
        return None
    _, _, zone, before = min(found)
    return zone, before, before
