"""What is done to the store while its files fail, and what has to be true of it afterwards.

A workload is a row of steps, each of which may be tried again after it failed. What is durable after each of them, a
run that nothing disturbs tells (`tests/service/store/test_contract.py` holds that this is right). `verify` opens what
is left and holds that everything up to the last finished step is there with the same bits, and nothing half.
"""

import asyncio
import math
import shutil
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine, Iterable
from contextlib import closing, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_zones import make_update

import service.store.journal
import service.store.journal_file
from adapters.reading import Quality, Reading
from service.errors import ServiceError, StateMismatch
from service.records.sample import Sample
from service.records.update import Update
from service.store.backup import restore_backup, write_backup
from service.store.checkpoint import Checkpoint, CheckpointStore
from service.store.journal import Journal
from service.store.retention import Limits, prune
from service.store.store import JOURNAL, RESTORING, Store

Content = frozenset[tuple[Any, ...]]
"""Everything that there is: its kind, its zone, its time, and all of its bits."""


class Workload(ABC):
    """Steps on `folder`, which exists."""

    midway: Content = frozenset()
    """What is there only while a step is under way."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.steps: list[Callable[[], object]] = []

    @abstractmethod
    def content(self, folder: Path) -> Content:
        """What there is in a folder, which then goes on."""

    def on_the_way(self, found: Content, done: int) -> bool:
        """Whether `found` may be there while the step after `done` of them is under way."""
        return False

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        """Hold that `folder` is as after `done` steps; the next one may have happened too, or not unless `exactly`.

        With `exactly` false only that no wrong bit is there.
        """
        found, states = self.content(folder), expected(type(self))
        if not exactly:
            known = self.midway.union(*states)
            assert found <= known, sorted(found - known)
            return
        before, after = states[done], states[min(done + 1, len(self.steps))]
        told = [sorted(item[:3] for item in content) for content in (found, before, after)]
        problem = f"after {done} steps there is {told[0]}, neither {told[1]} nor {told[2]}"
        assert found in (before, after) or self.on_the_way(found, done), problem


@cache
def expected(kind: type[Workload]) -> list[Content]:
    """What is durable after each number of steps, as a death of the process would leave it."""
    with tempfile.TemporaryDirectory() as name:
        live = Path(name) / "state"
        live.mkdir()
        workload = kind(live)

        def durable() -> Content:
            copy = Path(name) / "copy" / "state"
            shutil.copytree(live, copy, ignore=shutil.ignore_patterns("*-shm"))
            with suppress(FileNotFoundError):
                shutil.copy(Path(name) / "backup.tar", copy.parent)
            content = workload.content(copy)
            shutil.rmtree(copy.parent)
            return content

        states = [durable()]
        for step in workload.steps:
            step()
            states.append(durable())
    return states


def sample(k: int) -> Sample:
    """Sample k, different from every other."""
    values = np.array([5.0 + k / 7, np.nan, -0.0])
    return Sample(300 * k, np.array([20.0 + k / 3]), values, (Quality.GOOD,), (Quality.GOOD, Quality.BAD, Quality.GOOD))


@cache
def update(k: int) -> Update:
    """The update of sample k."""
    return make_update(k)._replace(time=300 * k)


def checkpoint(number: int) -> Checkpoint:
    """Checkpoint `number`, different from every other; of a few pages."""
    return Checkpoint("mark", number, {"x": np.random.default_rng(number).normal(size=700)}, {"number": number})


def samples(zone: str, found: Iterable[Sample]) -> set[tuple[Any, ...]]:
    """Samples in a form that compares bit for bit."""
    return {
        ("sample", zone, one.time, one.outputs.tobytes() + one.inputs.tobytes(), one.output_quality, one.input_quality)
        for one in found
    }


def newest(found: Checkpoint | None) -> set[tuple[Any, ...]]:
    """The same of a checkpoint."""
    if found is None:
        return set()
    bits = found.arrays["x"].tobytes()
    return {("checkpoint", found.zone, found.step, found.meta["number"], found.fingerprint, bits)}


class JournalWorkload(Workload):
    """Everything that is done to a journal."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        service.store.journal.DELETED_AT_ONCE = 3
        service.store.journal_file.PAGES_AT_ONCE = 2
        self._journal: Journal | None = None
        steps = self.steps
        steps.append(self._open)
        steps += [lambda zone=zone: self.journal.claim(zone, "mark") for zone in "ab"]
        for k in range(4):
            steps += [self._append(k), self._record("a", k)]
        steps += [self._keep("a", 1), lambda: self.journal.flush(), lambda: self.journal.skip("b", 300, "invented")]
        steps.append(lambda: self.journal.read("PRAGMA wal_checkpoint(PASSIVE)"))
        for k in range(4, 12):
            steps += [self._append(k), self._record("b", k)]
        steps.append(lambda: self.journal.flush())
        self._pruning = len(steps)
        steps.append(lambda: list(prune(self.journal, lambda zone: 4 * 300, Limits(3 * 300, math.inf))))
        steps += [lambda: self.journal.read("PRAGMA wal_checkpoint(RESTART)"), self._append(12), self._close]
        steps += [self._open, self._append(13), self._keep("a", 14), self._keep("b", 14)]
        steps += [lambda: self.journal.forget("b"), self._append(14)]

    @property
    def journal(self) -> Journal:
        """The open journal."""
        assert self._journal is not None
        return self._journal

    def _open(self) -> None:
        if self._journal is None:
            self._journal = Journal.open(self.folder / JOURNAL)

    def _close(self) -> None:
        journal, self._journal = self._journal, None
        if journal is not None:
            journal.close()

    def _append(self, k: int) -> Callable[[], object]:
        return lambda: self.journal.append_all([(zone, sample(k)) for zone in "ab"])

    def _record(self, zone: str, k: int) -> Callable[[], object]:
        return lambda: self.journal.record(zone, update(k))

    def _keep(self, zone: str, k: int) -> Callable[[], object]:
        kept = Reading(f"{zone}/T", 300 * k + 7.5, 20.0 + k / 3, Quality.UNCERTAIN)
        return lambda: self.journal.append_all([], [(zone, [kept])])

    def content(self, folder: Path) -> Content:
        with closing(Journal.open(folder / JOURNAL)) as journal:
            found = set[tuple[Any, ...]]()
            for zone in "ab":
                found |= samples(zone, journal.samples_after(zone, None))
                found |= {("row", zone, row.time, repr(row)) for row in journal.history(zone, None, None, 1000)}
                found |= {("reading", zone, one.time, repr(one)) for one in journal.kept(zone, 0.0)}
            assert journal.append_all([("a", sample(100))]), "it goes on"
        return frozenset(found)

    def on_the_way(self, found: Content, done: int) -> bool:
        """Pruning goes from the oldest on: nothing is missing in the middle."""
        before, after = expected(type(self))[done : done + 2]
        return (done == self._pruning and after <= found <= before) and all(
            gone[2] < one[2] for gone in before - found for one in found if one[:2] == gone[:2]
        )


class CheckpointWorkload(Workload):
    """Six checkpoints of a zone, of which three stay."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        store = CheckpointStore(folder / "checkpoints")
        self.steps = [lambda number=number: store.save("z", checkpoint(number)) for number in range(1, 7)]

    def content(self, folder: Path) -> Content:
        store = CheckpointStore(folder / "checkpoints")
        found = newest(store.load("z", "mark"))
        assert store.save("z", checkpoint(50)).exists(), "it goes on"
        assert not list((folder / "checkpoints").glob("z/*.tmp")), "no half file stays"
        return frozenset(found)

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        super().verify(folder, done, exactly)
        if exactly:
            assert not list((folder / "checkpoints").glob("z/*.corrupt")), "none is damaged under its own name"


class StoreWorkload(Workload):
    """Steps on a store that is open."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._store: Store | None = None

    @property
    def store(self) -> Store:
        """The open store."""
        assert self._store is not None
        return self._store

    def _open(self) -> None:
        if self._store is None:
            self._store = Store(self.folder)

    def _close(self) -> None:
        store, self._store = self._store, None
        if store is not None:
            store.close()

    def _does(self, work: Callable[[Store], Coroutine[Any, Any, object]]) -> Callable[[], object]:
        return lambda: asyncio.run(work(self.store))

    def content(self, folder: Path) -> Content:
        async def looked(store: Store) -> Content:
            for mark in ("mark", "new"):
                with suppress(StateMismatch):
                    await store.claim("z", mark)
                    found = newest(store.checkpoints.load("z", mark))
                    return frozenset(found | samples("z", await store.samples_after("z", None)))
            raise AssertionError("its state belongs to something else")

        with closing(Store(folder)) as store:
            return asyncio.run(looked(store))


class ResetWorkload(StoreWorkload):
    """A zone with samples and a checkpoint is reset and begins anew with another network."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.steps = [
            self._open,
            self._does(lambda store: store.claim("z", "mark")),
            *(self._does(lambda store, k=k: store.append("z", sample(k))) for k in range(3)),
            lambda: self.store.checkpoints.save("z", checkpoint(1)),
            self._does(lambda store: store.forget("z")),
            self._does(lambda store: store.claim("z", "new")),
            self._does(lambda store: store.append("z", sample(7))),
            lambda: self.store.checkpoints.save("z", checkpoint(7)._replace(fingerprint="new")),
            self._close,
        ]


class SetBackWorkload(StoreWorkload):
    """What a zone learned from a clock that was ahead is set aside."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        first, ahead, then = (checkpoint(n)._replace(step=300 * k) for n, k in ((1, 2), (2, 4), (3, 2)))
        self.steps = [
            self._open,
            self._does(lambda store: store.claim("z", "mark")),
            *(self._does(lambda store, k=k: store.append("z", sample(k))) for k in range(5)),
            lambda: self.store.checkpoints.save("z", first),
            self._does(lambda store: store.set_back("z", ahead, then, 600)),
            self._does(lambda store: store.append("z", sample(3))),
            self._close,
        ]
        self.midway = frozenset(newest(ahead._replace(zone="z")))

    def on_the_way(self, found: Content, done: int) -> bool:
        """The state before, with or without what followed it in the journal."""
        before, after = (
            frozenset(one for one in state if one[0] == "sample") for state in expected(type(self))[done : done + 2]
        )
        return done == 8 and found in (before | self.midway, after | self.midway)


@cache
def backup() -> bytes:
    """A backup of samples 10 to 14 and the checkpoint after the 12th."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with closing(Journal.open(folder / JOURNAL)) as journal:
            journal.append_all([("z", sample(k)) for k in range(10, 15)])
        CheckpointStore(folder / "checkpoints").save("z", checkpoint(12))
        return write_backup(folder, "site", folder / "backup.tar").path.read_bytes()


class RestoreWorkload(StoreWorkload):
    """A backup takes the place of state that is there."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._backup = folder.parent / "backup.tar"
        self._backup.write_bytes(backup())
        self.steps = [self._begin, self._restore, self._go_on]

    def _begin(self) -> None:
        with closing(Journal.open(self.folder / JOURNAL)) as journal:
            journal.append_all([("z", sample(k)) for k in range(3)])
        CheckpointStore(self.folder / "checkpoints").save("z", checkpoint(1))

    def _restore(self) -> None:
        restore_backup(self.folder, "site", self._backup, replace=True)

    def _go_on(self) -> None:
        with closing(Journal.open(self.folder / JOURNAL)) as journal:
            journal.append_all([("z", sample(15))])

    def content(self, folder: Path) -> Content:
        if (folder / RESTORING).exists():
            with pytest.raises(ServiceError, match="run `thermogate restore` again"):
                Store(folder)
            restore_backup(folder, "site", self._backup, replace=False)
        return super().content(folder)

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        # The state that is replaced is another workload's affair.
        if done > 0:
            assert done == 1 or not (folder / RESTORING).exists(), "a finished restore leaves nothing of this kind"
            super().verify(folder, done, exactly)


WORKLOADS: dict[str, Callable[[Path], Workload]] = {
    "journal": JournalWorkload,
    "checkpoints": CheckpointWorkload,
    "reset": ResetWorkload,
    "set back": SetBackWorkload,
    "restore": RestoreWorkload,
}
