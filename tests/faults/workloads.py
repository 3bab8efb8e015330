"""What is done to the store while its files fail, and what has to be true of it afterwards.

A workload is a row of steps, each of which may be tried again after it failed. `verify` opens what is left and holds
that everything up to the last finished step is there with the same bits, and nothing half.
"""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Callable, Coroutine
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest
from faults.journal_workload import JournalWorkload, sample

from service.errors import ServiceError, StateMismatch
from service.store.backup import restore_backup, write_backup
from service.store.checkpoint import Checkpoint, CheckpointStore
from service.store.journal import Journal
from service.store.store import JOURNAL, RESTORING, Store


class Workload(Protocol):
    """Steps on a folder, and what has to be true after some of them."""

    steps: list[Callable[[], object]]

    def verify(self, folder: Path, done: int, exactly: bool) -> None:
        """Hold that `folder` is as after `done` steps; the next one may have happened too, or not unless `exactly`.

        With `exactly` false only that no wrong bit is there.
        """


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


class SetBackWorkload(ResetWorkload):
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

    async def _verify(self, store: Store, done: int, exactly: bool) -> None:
        found = store.checkpoints.load("z", "mark")
        state = ([item.time // 300 for item in await store.samples_after("z", None)], found and found.meta["number"])
        appended = [*range(min(5, max(0, done - 2)))]
        if not exactly:
            return
        if done < 7:
            assert state in ((appended, None), ([*appended, len(appended)], None)), (done, state)
        elif done == 7:
            assert state in ((appended, None), (appended, 1)), state
        elif done == 8:
            # The state before, with or without what followed it in the journal; or the end.
            assert state in ((appended, 1), (appended, 2), ([0, 1, 2], 2), ([0, 1, 2], 3)), state
        else:
            assert state in (([0, 1, 2], 3), ([0, 1, 2, 3], 3))
            assert done < 10 or state[0] == [0, 1, 2, 3]


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
            journal.append_all([("z", sample(15))])

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
    "set back": SetBackWorkload,
    "restore": RestoreWorkload,
}
