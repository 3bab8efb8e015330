"""Everything that is done to a journal, with what has to be in it after each step."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from support.fake_zones import make_update

import service.store.journal
import service.store.journal_file
from adapters.reading import Quality, Reading
from service.records.history import HistoryRow
from service.records.sample import Sample
from service.store.journal import REMEMBERED, Journal
from service.store.retention import Limits, prune
from service.store.store import JOURNAL

Content = dict[str, tuple[dict[int, bytes], dict[int, HistoryRow], dict[float, Reading]]]
"""Samples in bytes, history rows and readings that were kept by time, of every zone."""
ZONES = ("a", "b")


def sample(k: int) -> Sample:
    """Sample k, different from every other."""
    values = np.array([5.0 + k / 7, np.nan, -0.0])
    return Sample(300 * k, np.array([20.0 + k / 3]), values, (Quality.GOOD,), (Quality.GOOD, Quality.BAD, Quality.GOOD))


def in_bytes(item: Sample) -> bytes:
    """A sample in a form that compares bit for bit."""
    words = ",".join((*item.output_quality, *item.input_quality))
    return item.outputs.tobytes() + item.inputs.tobytes() + words.encode()


def history_row(k: int) -> HistoryRow:
    """History row k."""
    return replace(HistoryRow.of(make_update(k)), time=300 * k)


def reading(zone: str, k: int) -> Reading:
    """Reading k of a zone, in the interval of sample k."""
    return Reading(f"{zone}/T", 300 * k + 7.5, 20.0 + k / 3, Quality.UNCERTAIN)


class JournalWorkload:
    """Everything that is done to a journal."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / JOURNAL
        self._journal: Journal | None = None
        self._now: Content = {zone: ({}, {}, {}) for zone in ZONES}
        self._recorded: dict[tuple[str, int], HistoryRow] = {}
        self.states: list[Content] = [self._copy()]
        """What has to be there after each number of steps."""
        self.steps: list[Callable[[], object]] = []
        service.store.journal.DELETED_AT_ONCE = 3
        service.store.journal_file.PAGES_AT_ONCE = 2
        self._add(self._open)
        for zone in ZONES:
            self._add(lambda zone=zone: self.journal.claim(zone, "mark"), commits=True)
        for k in range(4):
            self._append(k)
            self._record("a", k)
        self._keep("a", 1)
        self._add(lambda: self.journal.flush(), commits=True)
        self._skip("b", 1)
        self._add(lambda: self.journal.read("PRAGMA wal_checkpoint(PASSIVE)"))
        for k in range(4, 12):
            self._append(k)
            self._record("b", k)
        self._add(lambda: self.journal.flush(), commits=True)
        self._prune()
        self._add(lambda: self.journal.read("PRAGMA wal_checkpoint(RESTART)"))
        self._append(12)
        self._add(self._close, commits=True)
        self._add(self._open)
        self._append(13)
        self._keep("a", 14)
        self._keep("b", 14)
        self._forget("b")
        self._append(14)

    @property
    def journal(self) -> Journal:
        """The open journal."""
        assert self._journal is not None
        return self._journal

    def _open(self) -> None:
        if self._journal is None:
            self._journal = Journal.open(self._path)

    def _close(self) -> None:
        journal, self._journal = self._journal, None
        if journal is not None:
            journal.close()

    def _copy(self) -> Content:
        return {
            zone: (dict(samples), dict(history), dict(kept)) for zone, (samples, history, kept) in self._now.items()
        }

    def _add(self, step: Callable[[], object], commits: bool = False) -> None:
        """A step; one that `commits` takes the recorded history along."""
        if commits:
            for (zone, time), row in self._recorded.items():
                self._now[zone][1][time] = row
            self._recorded.clear()
        self.steps.append(step)
        self.states.append(self._copy())

    def _append(self, k: int) -> None:
        for zone in ZONES:
            samples, _, kept = self._now[zone]
            samples[300 * k] = in_bytes(sample(k))
            for time in [time for time in kept if time < 300 * k - REMEMBERED]:
                del kept[time]
        self._add(lambda: self.journal.append_all([(zone, sample(k)) for zone in ZONES]), commits=True)

    def _keep(self, zone: str, k: int) -> None:
        self._now[zone][2][reading(zone, k).time] = reading(zone, k)
        self._add(lambda: self.journal.keep(zone, [reading(zone, k)]), commits=True)

    def _record(self, zone: str, k: int) -> None:
        self._recorded[zone, 300 * k] = history_row(k)
        self._add(lambda: self.journal.record(zone, make_update(k)._replace(time=300 * k)))

    def _skip(self, zone: str, k: int) -> None:
        del self._now[zone][0][300 * k]
        self._add(lambda: self.journal.skip(zone, 300 * k, "invented"), commits=True)

    def _prune(self) -> None:
        for samples, history, _ in self._now.values():
            for time in [time for time in samples if time < 5 * 300]:
                del samples[time]
            for time in [time for time in history if time < 8 * 300]:
                del history[time]
        limits = Limits(3 * 300, math.inf)
        self._add(lambda: list(prune(self.journal, lambda zone: 4 * 300, limits)), commits=True)

    def _forget(self, zone: str) -> None:
        self._now[zone] = ({}, {}, {})
        self._add(lambda: self.journal.forget(zone), commits=True)

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        journal = Journal.open(folder / JOURNAL)
        try:
            found: Content = {
                zone: (
                    {item.time: in_bytes(item) for item in journal.samples_after(zone, None)},
                    {row.time: row for row in journal.history(zone, None, None, 1000)},
                    {kept.time: kept for kept in journal.kept(zone, 0.0, math.inf)},
                )
                for zone in ZONES
            }
            if exactly:
                before, after = self.states[done], self.states[min(done + 1, len(self.steps))]
                assert any(same(found, state) for state in (before, after)) or between(found, before, after), (
                    f"after {done} steps there is {times(found)}, neither {times(before)} nor {times(after)}"
                )
            else:
                for zone in ZONES:
                    assert all(in_bytes(sample(time // 300)) == data for time, data in found[zone][0].items())
                    assert all(repr(history_row(time // 300)) == repr(row) for time, row in found[zone][1].items())
                    assert all(reading(zone, int(time // 300)) == kept for time, kept in found[zone][2].items())
            assert journal.append_all([("a", sample(100))]), "it goes on"
        finally:
            journal.close()


def times(content: Content) -> dict[str, list[list[float]]]:
    """What there is, for a message."""
    return {zone: [sorted(rows) for rows in parts] for zone, parts in content.items()}


def same(one: Content, other: Content) -> bool:
    """Whether both hold the same bits; NaN is NaN."""
    first, second = (
        {zone: [sorted(rows.items()) for rows in parts] for zone, parts in content.items()} for content in (one, other)
    )
    return repr(first) == repr(second)


def between(found: Content, before: Content, after: Content) -> bool:
    """Whether `found` is on the way from `before` to `after`, where rows only go: what pruning leaves in the middle."""
    for zone in ZONES:
        for have, had, keep in zip(found[zone], before[zone], after[zone], strict=True):
            if not set(keep) <= set(have) <= set(had) or any(repr(have[time]) != repr(had[time]) for time in have):
                return False
            # From the oldest on: nothing is missing in the middle.
            if sorted(have) != sorted(had)[len(had) - len(have) :]:
                return False
    return True
