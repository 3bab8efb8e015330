"""What is done to the store while its files fail, and what has to be true of it afterwards.

A workload is a row of steps, each of which may be tried again after it failed. `verify` opens what is left and holds
that everything up to the last finished step is there with the same bits, and nothing half.
"""

from __future__ import annotations

import asyncio
import math
import tarfile
import tempfile
from collections.abc import Callable, Coroutine
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest
from fake_zones import make_update

import service.retention
from adapters.reading import Quality
from service.backup import restore_backup, write_backup
from service.checkpoint import Checkpoint, CheckpointStore
from service.durable_files import sync_folder, write_file
from service.errors import ServiceError, StateMismatch
from service.journal import HistoryRow, Journal
from service.records import Sample
from service.retention import Limits, prune
from service.store import JOURNAL, RESTORING, Store

Content = dict[str, tuple[dict[int, bytes], dict[int, HistoryRow]]]
"""Samples in bytes and history rows by time, of every zone."""
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
    return HistoryRow.of(make_update(k))._replace(time=300 * k)


class Workload(Protocol):
    """Steps on a folder, and what has to be true after some of them."""

    steps: list[Callable[[], object]]

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        """Hold that `folder` is as after `done` steps; the next one may have happened too, or not unless `exactly`.

        With `exactly` false only that no wrong bit is there.
        """


class JournalWorkload:
    """Everything that is done to a journal."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / JOURNAL
        self._journal: Journal | None = None
        self._now: Content = {zone: ({}, {}) for zone in ZONES}
        self._recorded: dict[tuple[str, int], HistoryRow] = {}
        self.states: list[Content] = [self._copy()]
        """What has to be there after each number of steps."""
        self.steps: list[Callable[[], object]] = []
        service.retention._ROWS_AT_ONCE = 3
        service.retention._PAGES_AT_ONCE = 2
        self._add(self._open)
        for zone in ZONES:
            self._add(lambda zone=zone: self.journal.claim(zone, "mark"), commits=True)
        for k in range(4):
            self._append(k)
            self._record("a", k)
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
        return {zone: (dict(samples), dict(history)) for zone, (samples, history) in self._now.items()}

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
            self._now[zone][0][300 * k] = in_bytes(sample(k))
        self._add(lambda: self.journal.append_all([(zone, sample(k)) for zone in ZONES]), commits=True)

    def _record(self, zone: str, k: int) -> None:
        self._recorded[zone, 300 * k] = history_row(k)
        self._add(lambda: self.journal.record(zone, make_update(k)._replace(time=300 * k)))

    def _skip(self, zone: str, k: int) -> None:
        del self._now[zone][0][300 * k]
        self._add(lambda: self.journal.skip(zone, 300 * k, "invented"), commits=True)

    def _prune(self) -> None:
        for samples, history in self._now.values():
            for time in [time for time in samples if time < 5 * 300]:
                del samples[time]
            for time in [time for time in history if time < 8 * 300]:
                del history[time]
        limits = Limits(3 * 300, math.inf)
        self._add(lambda: list(prune(self.journal, lambda zone: 4 * 300, limits)), commits=True)

    def _forget(self, zone: str) -> None:
        self._now[zone] = ({}, {})
        self._add(lambda: self.journal.forget(zone), commits=True)

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        journal = Journal.open(folder / JOURNAL)
        try:
            found: Content = {
                zone: (
                    {item.time: in_bytes(item) for item in journal.samples_after(zone, None)},
                    {row.time: row for row in journal.history(zone, None, None, 1000)},
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
            assert journal.append("a", sample(100)), "it goes on"
        finally:
            journal.close()


def times(content: Content) -> dict[str, tuple[list[int], list[int]]]:
    """What there is, for a message."""
    return {zone: (sorted(samples), sorted(history)) for zone, (samples, history) in content.items()}


def same(one: Content, other: Content) -> bool:
    """Whether both hold the same bits; NaN is NaN."""
    return repr({zone: (sorted(s.items()), sorted(h.items())) for zone, (s, h) in one.items()}) == repr(
        {zone: (sorted(s.items()), sorted(h.items())) for zone, (s, h) in other.items()}
    )


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


class CheckpointWorkload:
    """Six checkpoints of a zone, of which three stay."""

    def __init__(self, folder: Path) -> None:
        store = CheckpointStore(folder / "checkpoints")
        self.steps: list[Callable[[], object]] = [
            lambda number=number: store.save("z", checkpoint(number)) for number in range(1, 7)
        ]

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        store = CheckpointStore(folder / "checkpoints")
        found = store.load("z", "mark")
        number = 0 if found is None else found.step
        if exactly:
            assert number in (done, done + 1), f"after {done} checkpoints the newest is {number}"
        if found is not None:
            assert repr(found.meta) == repr(checkpoint(number).meta)
            assert found.arrays["x"].tobytes() == checkpoint(number).arrays["x"].tobytes()
        files = list((folder / "checkpoints" / "z").glob("*")) if found is not None else []
        assert not [path for path in files if path.suffix == ".tmp"], "no half file stays"
        if exactly:
            assert not [path for path in files if path.suffix == ".corrupt"], "none is damaged under its own name"
        assert store.save("z", checkpoint(50)).exists(), "it goes on"


def checkpoint(number: int) -> Checkpoint:
    """Checkpoint `number`, different from every other; of a few pages."""
    return Checkpoint("mark", number, {"x": np.random.default_rng(number).normal(size=700)}, {"number": number})


class ResetWorkload:
    """A zone with samples and a checkpoint is reset and begins anew with another network."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._store: Store | None = None
        self.steps: list[Callable[[], object]] = [
            self._open,
            self._does(lambda store: store.claim("z", "old")),
            *(self._does(lambda store, k=k: store.append("z", sample(k))) for k in range(3)),
            lambda: self.store.checkpoints.save("z", checkpoint(1)._replace(fingerprint="old")),
            self._does(lambda store: store.forget("z")),
            self._does(lambda store: store.claim("z", "new")),
            self._does(lambda store: store.append("z", sample(7))),
            lambda: self.store.checkpoints.save("z", checkpoint(7)._replace(fingerprint="new")),
            self._close,
        ]
        self._forgetting = 6

    @property
    def store(self) -> Store:
        """The open store."""
        assert self._store is not None
        return self._store

    def _open(self) -> None:
        if self._store is None:
            self._store = Store(self._folder)

    def _close(self) -> None:
        store, self._store = self._store, None
        if store is not None:
            store.close()

    def _does(self, work: Callable[[Store], Coroutine[Any, Any, object]]) -> Callable[[], object]:
        return lambda: asyncio.run(work(self.store))

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        store = Store(folder)
        try:
            asyncio.run(self._verify(store, done, exactly))
        finally:
            store.close()

    async def _verify(self, store: Store, done: int, exactly: bool) -> None:
        try:
            await store.claim("z", "old")
            found = store.checkpoints.load("z", "old")
            mark = "old"
        except StateMismatch:
            await store.claim("z", "new")
            found = store.checkpoints.load("z", "new")
            mark = "new"
        times = [item.time // 300 for item in await store.samples_after("z", None)]
        if not exactly:
            return
        if done < self._forgetting:
            assert times in ([*range(3)][: max(0, done - 2)], [*range(3)][: max(0, done - 1)]), (done, times)
            assert mark == "old"
            assert found is None or (done, found.step) == (self._forgetting - 1, 1)
        elif done == self._forgetting:
            # The reset was under way: all of the old, or nothing of it.
            assert (times, found is None) in (([0, 1, 2], False), ([], True)), (times, found)
        else:
            assert times in ([], [7])
            assert found is None or (mark, found.step) == ("new", 7)
            assert done < 9 or times == [7]
            assert done < 10 or found is not None


VERSION_1 = Path(__file__).parents[1] / "service" / "state-version-1.tar.gz"
"""A state folder of schema 1, taken from a running daemon: zone z with 40 samples, of which the 34th is skipped."""


class UpgradeWorkload:
    """A journal of version 1 is opened, brought up, and gone on with."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / JOURNAL
        self._journal: Journal | None = None
        with tarfile.open(VERSION_1) as archive:
            members = [member for member in archive.getmembers() if member.name.startswith(JOURNAL)]
            self._files = {member.name: archive.extractfile(member).read() for member in members}  # type: ignore[union-attr]
        self.steps: list[Callable[[], object]] = [self._lay_down, self._open, self._append, self._close]

    def _lay_down(self) -> None:
        try:
            for name, content in self._files.items():
                write_file(self._path.with_name(name), content)
            sync_folder(self._path.parent)
        except OSError as error:
            raise ServiceError(f"{self._path}: {error.strerror}") from error

    def _open(self) -> None:
        if self._journal is None:
            self._journal = Journal.open(self._path)

    def _append(self) -> None:
        assert self._journal is not None
        self._journal.append("z", sample(40))

    def _close(self) -> None:
        journal, self._journal = self._journal, None
        if journal is not None:
            journal.close()

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        if done == 0:
            return  # what was before is not this journal's affair
        journal = Journal.open(folder / JOURNAL)
        try:
            times = [item.time // 300 for item in journal.samples_after("z", None)]
            rows = [row.time // 300 for row in journal.history("z", None, None, 100)]
            old = [k for k in range(40) if k != 33]
            assert times in (old, [*old, 40]), times
            assert done < 3 or times == [*old, 40], times
            assert rows == list(range(28)), rows
            assert journal.read("PRAGMA user_version") == [(2,)]
            assert journal.read("PRAGMA auto_vacuum") == [(2,)], "space can be given back"
            assert journal.append("z", sample(50)), "it goes on"
        finally:
            journal.close()


@cache
def backup() -> bytes:
    """A backup of samples 10 to 14 and the checkpoint after the 12th."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with closing(Journal.open(folder / JOURNAL)) as journal:
            journal.append_all([("z", sample(k)) for k in range(10, 15)])
        CheckpointStore(folder / "checkpoints").save("z", checkpoint(12))
        return write_backup(folder, "site", folder / "backup.tar").path.read_bytes()


class RestoreWorkload:
    """A backup takes the place of state that is there."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._backup = folder.parent / "backup.tar"
        self._backup.write_bytes(backup())
        self.steps: list[Callable[[], object]] = [self._begin, self._restore, self._go_on]

    def _begin(self) -> None:
        with closing(Journal.open(self._folder / JOURNAL)) as journal:
            journal.append_all([("z", sample(k)) for k in range(3)])
        CheckpointStore(self._folder / "checkpoints").save("z", checkpoint(1))

    def _restore(self) -> None:
        restore_backup(self._folder, "site", self._backup, replace=True)

    def _go_on(self) -> None:
        with closing(Journal.open(self._folder / JOURNAL)) as journal:
            journal.append("z", sample(15))

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        if done == 0:
            return  # the state that is replaced is another workload's affair
        if (folder / RESTORING).exists():
            assert done == 1, "a finished restore leaves nothing of this kind"
            with pytest.raises(ServiceError, match="run `thermogate restore` again"):
                Store(folder)
            restore_backup(folder, "site", self._backup, replace=False)
            done = 2
        store = Store(folder)
        try:
            times = [item.time // 300 for item in asyncio.run(store.samples_after("z", None))]
            found = store.checkpoints.load("z", "mark")
        finally:
            store.close()
        new = [*range(10, 15)]
        old = (list(range(3)), 1)
        allowed = {1: [old, (new, 12)], 2: [(new, 12), ([*new, 15], 12)], 3: [([*new, 15], 12)]}
        assert (times, found.step if found else None) in allowed[done], (done, times, found and found.step)


WORKLOADS: dict[str, Callable[[Path], Workload]] = {
    "journal": JournalWorkload,
    "checkpoints": CheckpointWorkload,
    "reset": ResetWorkload,
    "upgrade": UpgradeWorkload,
    "restore": RestoreWorkload,
}
