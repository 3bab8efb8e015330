"""The failing file layer as tests use it: compiled, loaded into a process of its own, and controlled from there."""

import ctypes
import errno
import os
import shutil
import struct
import subprocess
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

SOURCE = Path(__file__).with_name("shim.c")


class Fault(IntEnum):
    """What becomes of an operation."""

    FAIL = 1
    FAIL_FROM_HERE = 2
    """It and every later one fails, until the fault is gone."""
    TEAR = 3
    """Half of it is written, then it fails."""
    DROP = 4
    """It reports success and has done nothing."""
    KILL = 5
    TEAR_AND_KILL = 6
    """Half of it is written, then the process is gone."""


class Operation(NamedTuple):
    """One operation that was recorded: C create, D make a folder, W write, T truncate, S sync, R rename, U remove;
    M is a mark of the test, with its number as `offset`."""

    kind: str
    offset: int
    path: str
    other: str
    data: bytes


def build(folder: Path) -> Path | None:
    """The compiled library in `folder`; None where there is no C compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    library = folder / "faults.so"
    flags = ["-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, "-o", str(library), str(SOURCE), "-ldl", "-lpthread"], check=True)
    return library


class Shim:
    """The library that this process was started with (LD_PRELOAD)."""

    def __init__(self) -> None:
        self._library = ctypes.CDLL(None)
        self._library.faults_count.restype = ctypes.c_long
        self._library.faults_hits.restype = ctypes.c_long

    def watch(self, folder: Path) -> None:
        """Count what happens under `folder`."""
        self._library.faults_watch(os.fsencode(folder))

    def arm(self, position: int, fault: Fault, number: int = errno.EIO) -> None:
        """Strike the operation at `position`, counted from now on; `number` is what the caller is told."""
        self._library.faults_arm(ctypes.c_long(position), int(fault), number)

    def disarm(self) -> None:
        """Let everything pass, and go on counting."""
        self._library.faults_disarm()

    @property
    def count(self) -> int:
        """Operations since `arm`."""
        return int(self._library.faults_count())

    @property
    def hits(self) -> int:
        """Operations that were struck since `arm`."""
        return int(self._library.faults_hits())

    def record(self, path: Path | None) -> None:
        """Write down every operation in `path` from now on; None ends it."""
        self._library.faults_record(os.fsencode(path) if path else b"")

    def mark(self, number: int) -> None:
        """Leave a mark in what is recorded."""
        self._library.faults_mark(ctypes.c_long(number))


def recorded(path: Path) -> Iterator[Operation]:
    """What `Shim.record` wrote."""
    content, at = path.read_bytes(), 0
    while at < len(content):
        kind, offset, *lengths = struct.unpack_from("=cqIII", content, at)
        at += 21
        parts = []
        for length in lengths:
            parts.append(content[at : at + length])
            at += length
        yield Operation(kind.decode(), offset, os.fsdecode(parts[0]), os.fsdecode(parts[1]), parts[2])
