"""What a power failure leaves of a folder, rebuilt from a record of everything that was done in it.

A write is safe once its file was synced, a name (created, renamed, removed) once its folder was synced. What was not
may be there or not; a write may also be torn between two sectors.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from faults.shim import Operation

SECTOR = 512
_VOLATILE = "-shm"
"""SQLite's index of the write-ahead log: it is rebuilt by whoever opens the database first."""


class _File:
    """The bytes of a file: those that are safe, and the changes since."""

    def __init__(self) -> None:
        self.safe = bytearray()
        self.changes: list[Operation] = []


class Case(NamedTuple):
    """A way in which the power failed: which unsafe changes of bytes and names are there."""

    name: str
    keeps: Callable[[int, int], bool]
    """Whether change number i of n is there."""
    names: bool
    """Whether the unsafe names are."""
    cut: int | None = None
    """Where the last change that is there is torn, in bytes."""


CASES = (
    Case("nothing unsynced is there", lambda i, n: False, False),
    Case("names only", lambda i, n: False, True),
    Case("bytes only", lambda i, n: True, False),
    Case("everything", lambda i, n: True, True),
    Case("the first half", lambda i, n: i < n // 2, True),
    Case("the second half", lambda i, n: i >= n // 2, True),
    Case("the last alone", lambda i, n: i == n - 1, True),
    Case("all but the last", lambda i, n: i != n - 1, True),
    Case("every other one", lambda i, n: i % 2 == 0, True),
)


class Disk:
    """A folder as the record of its operations makes it, one operation at a time."""

    def __init__(self, root: Path) -> None:
        self._root = str(root)
        self._names: dict[str, _File | None] = {}
        """What there is now; None is a folder."""
        self._safe_names: dict[str, _File | None] = {}
        self._moved: list[tuple[str, str]] = []
        """Folders that were renamed: what is safe in them goes with them once their new name is safe."""
        self._changes: list[tuple[_File, Operation]] = []
        """Changes of bytes that are not safe, in the order in which they were made."""

    def apply(self, operation: Operation) -> None:
        """One operation more."""
        kind, _, path, other, _ = operation
        if path.endswith(_VOLATILE) or kind == "M":
            return
        if kind in "CD":
            self._names[path] = _File() if kind == "C" else None
        elif kind == "R":
            if self._names[path] is None:
                self._moved.append((path, other))
            for name in [name for name in self._names if name == path or name.startswith(f"{path}/")]:
                self._names[other + name[len(path) :]] = self._names.pop(name)
        elif kind == "U":
            self._names.pop(path, None)
        elif kind in "WT":
            file = self._names[path]
            assert file is not None
            self._changes.append((file, operation))
        elif path == self._root or self._names[path] is None:
            self._sync_names(path)
        else:
            self._sync_bytes(self._names[path])

    def _sync_names(self, folder: str) -> None:
        def inside(names: dict[str, _File | None]) -> set[str]:
            return {name for name in names if name.rpartition("/")[0] == folder}

        for name in inside(self._safe_names) - inside(self._names):
            del self._safe_names[name]
        for name in inside(self._names):
            self._safe_names[name] = self._names[name]
        for old, new in [move for move in self._moved if move[1] in self._safe_names]:
            for name in [name for name in self._safe_names if name.startswith(f"{old}/")]:
                self._safe_names[new + name[len(old) :]] = self._safe_names.pop(name)
            self._moved.remove((old, new))

    def _sync_bytes(self, file: _File | None) -> None:
        assert file is not None
        for changed, operation in self._changes:
            if changed is file:
                _change(file.safe, operation)
        self._changes = [(changed, operation) for changed, operation in self._changes if changed is not file]

    def cases(self) -> Iterator[Case]:
        """Every way in which the power may fail now, the tears of the last write included."""
        yield from CASES
        if self._changes and self._changes[-1][1].kind == "W":
            operation = self._changes[-1][1]
            # Sectors are those of the disk, wherever the write begins.
            first = SECTOR - operation.offset % SECTOR
            for cut in range(first, len(operation.data), SECTOR):
                yield Case(f"torn after {cut} bytes", lambda i, n: True, True, cut)

    def left(self, case: Case) -> dict[str, bytes | None]:
        """What is left in that case: the bytes of every file by its path in the folder, and None for a folder."""
        content: dict[int, bytearray] = {}
        for number, (file, operation) in enumerate(self._changes):
            if case.keeps(number, len(self._changes)):
                if case.cut is not None and number == len(self._changes) - 1:
                    operation = operation._replace(data=operation.data[: case.cut])
                _change(content.setdefault(id(file), bytearray(file.safe)), operation)
        names = self._names if case.names else self._safe_names
        return {
            path[len(self._root) + 1 :]: None if kind is None else bytes(content.get(id(kind), kind.safe))
            for path, kind in names.items()
        }


def write(left: Mapping[str, bytes | None], folder: Path) -> None:
    """Write what is `left` into the empty `folder`."""
    for path in sorted(left, key=len):
        target, content = folder / path, left[path]
        if not target.parent.is_dir():
            continue  # its folder's own name was lost
        if content is None:
            target.mkdir()
        else:
            target.write_bytes(content)


def _change(content: bytearray, operation: Operation) -> None:
    size = operation.offset
    if operation.kind == "T":
        del content[size:]
    content.extend(bytes(max(0, size - len(content))))
    if operation.kind == "W":
        content[size : size + len(operation.data)] = operation.data


def prefixes(root: Path, operations: Sequence[Operation]) -> Iterator[tuple[int, Disk]]:
    """The disk after each of `operations`, with the number of marks passed until then."""
    disk, marks = Disk(root), 0
    yield 0, disk
    for operation in operations:
        disk.apply(operation)
        if operation.kind == "M":
            marks = operation.offset
        yield marks, disk
