"""What a store is made of, whatever keeps it: SQLite in a folder, or PostgreSQL."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import Protocol

import numpy as np
import numpy.typing as npt

from adapters.reading import Reading
from service.records.history import HistoryRow
from service.records.sample import Sample
from service.records.update import Update
from service.store.checkpoint import Checkpoint

Columns = tuple[npt.NDArray[np.int64], npt.NDArray[np.float64], int | None]
"""Times [UTC s] (n,), values (n, m), and where the next page begins; None: there is none."""


class Checkpoints(Protocol):
    """The newest checkpoints of all zones. It blocks, and is asked from threads."""

    def save(self, zone: str, checkpoint: Checkpoint, *, keep_all: bool = False) -> object:
        """Write `checkpoint`, durable on return, and remove the oldest ones, unless to `keep_all`."""

    def load(self, zone: str, fingerprint: str) -> Checkpoint | None:
        """The newest sound checkpoint of `zone`, None if there is none; a damaged one is set aside.

        StateMismatch if it has another `fingerprint`.
        """

    def oldest(self, zone: str) -> int | None:
        """The step of the oldest kept checkpoint of `zone`; None if there is none."""

    def reset(self, zone: str) -> object:
        """Set all checkpoints of `zone` aside."""

    def set_aside(self, zone: str, after: int) -> object:
        """Set those aside that were taken later than `after`."""


class SampleJournal(Protocol):
    """The journal under a store: blocking, for one thread at a time. Every method may raise JournalError."""

    def claim(self, zone: str, fingerprint: str) -> bool:
        """Whether the samples of `zone` belong to `fingerprint`; a zone without samples takes it over."""

    def append_all(self, accepted: Sequence[tuple[str, Sample]]) -> int:
        """Store samples of zones, all or none of them; how many were not stored already. Fenced for zones that are
        another owner's."""

    def keep(self, zone: str, readings: Sequence[Reading]) -> None:
        """Store usable readings, durable on return; one that is there already stays."""

    def kept(self, zone: str, since: float, until: float = inf) -> list[Reading]:
        """The readings of `zone` that were kept, with `since` <= time <= `until` (UTC s), oldest first."""

    def record(self, zone: str, update: Update) -> None:
        """Add or replace the history row of `update`; durable with the next append, flush or close."""

    def flush(self) -> None:
        """Make the recorded history durable."""

    def skip(self, zone: str, time: int, reason: str) -> None:
        """Mark a stored sample as one that must not be assimilated."""

    def samples_after(self, zone: str, time: int | None) -> Iterator[Sample]:
        """The samples of `zone` later than `time` (None: all), in order, without the skipped ones."""

    def last_sample_time(self, zone: str) -> int | None:
        """Time of the newest stored sample of `zone`, skipped or not."""

    def pruned_until(self, zone: str) -> int | None:
        """Time of the newest sample of `zone` that was deleted to keep the journal small; None if none was."""

    def history(self, zone: str, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (None: open), oldest first."""

    def history_columns(self, zone: str, start: int, end: int, every: int) -> Columns:
        """A page of history rows with `start` <= time < `end` at multiples of `every` s, all columns (n, m)."""

    def input_columns(self, zone: str, start: int, end: int, every: int, width: int) -> Columns:
        """The same for the `width` inputs of accepted samples."""

    def forget(self, zone: str) -> None:
        """Set aside all of `zone`; until `forgot`, `is_forgotten` tells so."""

    def is_forgotten(self, zone: str) -> bool:
        """Whether `zone` is being forgotten."""

    def forgot(self, zone: str) -> None:
        """Nothing is left of `zone`."""

    def samples_ahead(self, zone: str, after: int) -> int:
        """How many samples of `zone` are later than `after`."""

    def set_aside(self, zone: str, after: int) -> None:
        """Set aside what is later than `after` of `zone`."""

    def close(self) -> None:
        """Flush and close; safe to call twice."""
