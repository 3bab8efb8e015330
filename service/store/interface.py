"""What a store is made of, whatever keeps it: SQLite in a folder, or PostgreSQL."""

from __future__ import annotations

import logging
import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import suppress
from math import inf
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from adapters.reading import Reading
from service.errors import JournalError
from service.records.history import HISTORY_COLUMNS, HistoryRow
from service.records.sample import Sample
from service.records.update import Update
from service.store.journal_rows import HistoryReader, damaged_sample, history_row, linked_sample, to_reading

DAY = 86_400
"""In s."""

REMEMBERED = 3600
"""Readings are kept for so many s beyond the sample that they went into, to be known if they are posted again."""

SERIES_ROWS = 4000
"""Rows that a chart reads at once, before other work of the journal's thread has its turn."""

PAGE = 500
"""Samples that are read at once."""

PENDING_LIMIT = 1000
"""Rows of history that wait for the next transaction at most."""

EARLIEST = -(2**63)
"""Not later than any sample."""

Columns = tuple[npt.NDArray[np.int64], npt.NDArray[np.float64], int | None]
"""Times [UTC s] (n,), values (n, m), and where the next page begins; None: there is none."""

_COLUMNS = ", ".join(HISTORY_COLUMNS)
_ROWS = "WHERE zone = ? AND time >= ? AND time < ? AND time % ? = 0 ORDER BY time LIMIT ?"
"""Of a chart: those at multiples of so many s."""

_FIRST = {table: f"SELECT min(time) FROM {table} WHERE zone = ?" for table in ("samples", "history", "readings")}
"""Asks for the time of the oldest row of a zone."""

_log = logging.getLogger(__name__)


class SampleJournal(ABC):
    """The journal under a store: blocking, for one thread at a time. Every method may raise JournalError.

    What is read is the same in SQLite and in PostgreSQL; `place` says in messages where, and `reset` how state is given
    up there (None: by `thermogate run --reset`).
    """

    _FINGERPRINTS: ClassVar[str]
    """Asks for zones with samples and what these belong to."""

    def __init__(self, place: str, reset: str | None = None) -> None:
        self._place, self._reset = place, reset
        self._pending: dict[tuple[str, int], tuple[Any, ...]] = {}
        """History rows that the next transaction takes along, by zone and time."""
        self._ends: dict[str, tuple[int, int]] = {}
        """Time and link of the newest sample of each zone that was written to since the journal was opened."""
        self._keeping: set[str] = set()
        """The zones that have readings of their own here."""
        self._reader = HistoryReader(place)

    @abstractmethod
    def read(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        """All rows of a question in SQLite's words, which finds rows by `zone = ?`."""

    @abstractmethod
    def claim(self, zone: str, fingerprint: str) -> bool:
        """Whether the samples of `zone` belong to `fingerprint`; a zone without samples takes it over."""

    @abstractmethod
    def append_all(self, accepted: Sequence[tuple[str, Sample]]) -> int:
        """Store samples of zones, all or none of them, durable on return with the history recorded so far; how many
        were not stored already. Fenced, with their names, for zones that are another owner's."""

    @abstractmethod
    def keep(self, zone: str, readings: Sequence[Reading]) -> None:
        """Store usable readings of an interval that is open, durable on return; one that is there already stays."""

    @abstractmethod
    def flush(self) -> None:
        """Make the recorded history durable."""

    @abstractmethod
    def skip(self, zone: str, time: int, reason: str) -> None:
        """Mark a stored sample as one that must not be assimilated; it stays where it is, with `reason`."""

    @abstractmethod
    def pruned_until(self, zone: str) -> int | None:
        """Time of the newest sample of `zone` that was deleted to keep the journal small; None if none was."""

    @abstractmethod
    def pruned_link(self, zone: str) -> int:
        """The link of that sample; 0 without any."""

    @abstractmethod
    def forget(self, zone: str) -> None:
        """Set aside all of `zone` under a name that no zone can have.

        Until `forgot`, `is_forgotten` tells that what else there is of the zone has to go too.
        """

    @abstractmethod
    def is_forgotten(self, zone: str) -> bool:
        """Whether `zone` is being forgotten."""

    @abstractmethod
    def forgot(self, zone: str) -> None:
        """Nothing is left of `zone`."""

    @abstractmethod
    def set_aside(self, zone: str, after: int) -> None:
        """Set aside what is later than `after` of `zone`, as `forget` does with all of it."""

    @abstractmethod
    def prunable(self) -> list[str]:
        """The zones of which rows may be deleted here, without what was set aside."""

    @abstractmethod
    def delete(self, zone: str, samples_before: int, history_before: int) -> bool:
        """Delete the oldest rows of `zone` before these times, a slice of each table; whether there may be more."""

    @abstractmethod
    def close(self) -> None:
        """Flush and close; safe to call twice."""

    def record(self, zone: str, update: Update) -> None:
        """Add or replace the history row of `update`; durable with the next append, flush or close."""
        self._pending[zone, update.time] = history_row(zone, HistoryRow.of(update))
        if len(self._pending) >= PENDING_LIMIT:
            self.flush()

    def kept(self, zone: str, since: float, until: float = inf) -> list[Reading]:
        """The readings of `zone` that were kept, with `since` <= time <= `until` (UTC s), oldest first.

        A damaged one is left out, which the log says.
        """
        query = (
            "SELECT time, channel, value, quality, checksum FROM readings WHERE zone = ? AND time BETWEEN ? AND ? "
            "ORDER BY time, channel"
        )
        found = []
        for row in self.read(query, zone, float(since), float(until)) if zone in self._keeping else ():
            try:
                found.append(to_reading((zone, *row)))
            except (ValueError, TypeError, AttributeError, struct.error) as error:
                _log.error("%s holds a damaged reading of zone '%s' (%s)", self._place, zone, error)
        return found

    def samples_after(self, zone: str, time: int | None) -> Iterator[Sample]:
        """The samples of `zone` later than `time` (None: all), in order, without the skipped ones.

        A skipped sample is left out, as if its interval had brought nothing. Writing between two items is allowed.
        JournalError where a sample is damaged or missing in the middle.
        """
        after = EARLIEST if time is None else time
        query = (
            "SELECT time, outputs, inputs, output_quality, input_quality, setpoint, link, skipped FROM samples "
            f"WHERE zone = ? AND time > ? ORDER BY time LIMIT {PAGE}"
        )
        rows = self.read(query, zone, after)
        previous = self.link_before(zone, after) if rows else 0
        while True:
            for *values, link, skipped in rows:
                try:
                    sample = linked_sample((zone, *values), link, previous)
                except (ValueError, TypeError, AttributeError, struct.error) as error:
                    raise damaged_sample(self._place, zone, values[0], error, self._reset) from error
                if skipped is None:
                    yield sample
                previous = link
            if len(rows) < PAGE:
                return
            after = rows[-1][0]
            rows = self.read(query, zone, after)

    def fingerprints(self) -> dict[str, str]:
        """What the samples of every zone that has any belong to, by its id."""
        return dict(self.read(self._FINGERPRINTS))

    def last_sample_time(self, zone: str) -> int | None:
        """Time of the newest stored sample of `zone`, skipped or not."""
        newest = self.read("SELECT time FROM samples WHERE zone = ? ORDER BY time DESC LIMIT 1", zone)
        return newest[0][0] if newest else None

    def sample_time_until(self, zone: str, time: int) -> int | None:
        """Time of the newest stored sample of `zone` up to `time`, skipped or not."""
        query = "SELECT max(time) FROM samples WHERE zone = ? AND time <= ?"
        newest: int | None = self.read(query, zone, time)[0][0]
        return newest

    def first_time(self, table: str, zone: str) -> int | None:
        """Time of the oldest row of `zone` in a table."""
        first: int | None = self.read(_FIRST[table], zone)[0][0]
        return first

    def samples_ahead(self, zone: str, after: int) -> int:
        """How many samples of `zone` are later than `after`."""
        return int(self.read("SELECT count(*) FROM samples WHERE zone = ? AND time > ?", zone, after)[0][0])

    def link_before(self, zone: str, time: int) -> int:
        """The link of the newest sample not later than `time`, pruned or not; 0 without any."""
        query = "SELECT link FROM samples WHERE zone = ? AND time <= ? ORDER BY time DESC LIMIT 1"
        rows = self.read(query, zone, time)
        return rows[0][0] or 0 if rows else self.pruned_link(zone)

    def history(self, zone: str, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (None: open), oldest first.

        A damaged row is left out, which the log says once.
        """
        self._show(zone)
        given = {"time >= ?": start, "time < ?": end}
        bounds = {condition: bound for condition, bound in given.items() if bound is not None}
        where = " AND ".join(["zone = ?", *bounds])
        query = f"SELECT {_COLUMNS}, checksum FROM history WHERE {where} ORDER BY time DESC LIMIT ?"
        return self._reader.rows(zone, reversed(self.read(query, zone, *bounds.values(), limit)))

    def history_columns(self, zone: str, start: int, end: int, every: int) -> Columns:
        """A page of history rows with `start` <= time < `end` at multiples of `every` s, all columns (n, m), NaN where
        there is no value. Damaged rows are left out, as in `history`."""
        self._show(zone)
        rows, following = self._page(f"SELECT {_COLUMNS}, checksum FROM history {_ROWS}", zone, start, end, every)
        return *self._reader.table(zone, rows), following

    def input_columns(self, zone: str, start: int, end: int, every: int, width: int) -> Columns:
        """The same for the `width` inputs of accepted samples.

        A damaged sample is left out as far as its length shows it: only a start, which assimilates, checks the chain.
        """
        rows, following = self._page(f"SELECT time, inputs FROM samples {_ROWS}", zone, start, end, every)
        whole = [(time, blob) for time, blob in rows if isinstance(blob, bytes) and len(blob) == 8 * width]
        times = np.array([time for time, _ in whole], dtype=np.int64)
        inputs = np.frombuffer(b"".join(blob for _, blob in whole), dtype="<f8").reshape(len(whole), width)
        return times, inputs.astype(np.float64), following

    def _page(
        self, query: str, zone: str, start: int, end: int, every: int
    ) -> tuple[list[tuple[Any, ...]], int | None]:
        """The next rows of a chart that `query` reads, the time of each first, and where the page after them begins."""
        rows = self.read(query, zone, start, end, every, SERIES_ROWS)
        return rows, rows[-1][0] + 1 if len(rows) == SERIES_ROWS else None

    def _show(self, zone: str) -> None:
        """Make durable what was recorded of `zone`, if it can be: what is there is read in any case."""
        # Reading need not wait for the disk because of other zones.
        if any(owner == zone for owner, _ in self._pending):
            with suppress(JournalError):
                self.flush()
