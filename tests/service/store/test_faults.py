"""Every single write, sync, rename and removal of the store fails, tears, is dropped, or is the last before a crash.

Of a workload's operations every fourth has its turn here; `make faults` tries them all.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from faults import shim
from faults.power_loss import CASES, Disk
from faults.power_loss import write as rebuild
from faults.shim import Operation

STRIDE = 1 if os.environ.get("FAULTS") == "all" else 4
SCRIPT = Path(shim.__file__).with_name("positions.py")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    built = shim.build(tmp_path_factory.mktemp("shim"))
    if built is None:
        pytest.skip("there is no C compiler to build the failing file layer with")
    return built


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder in memory where there is one: thousands of syncs to a disk take minutes."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else tmp_path) as name:
        yield Path(name)


@pytest.mark.parametrize("workload", ["checkpoints", "journal", "reset", "restore", "set back"])
def test_nothing_acknowledged_is_lost_at_any_position(workload: str, library: Path, folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(folder), str(STRIDE), workload],
        env=os.environ | {"LD_PRELOAD": str(library)},
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    counts = json.loads(done.stdout)[workload]
    # Seven faults that pass or last, two deaths and one drop at each position, and the power failures between them.
    assert counts["operations"] > 30
    assert counts["positions"] >= counts["operations"] / STRIDE
    assert counts["tries"] == 10 * counts["positions"] + counts["power failures"]
    assert counts["killed"] == 2 * counts["positions"]
    assert counts["power failures"] > len(CASES) * counts["operations"]
    assert counts["told"] > 5 * counts["positions"], "faults are told, not passed over"


def write(path: str, data: bytes, offset: int = 0) -> Operation:
    return Operation("W", offset, path, "", data)


def left(operations: list[Operation], tmp_path: Path) -> list[dict[str, bytes]]:
    """What each way of failing leaves behind `operations` in /d."""
    disk = Disk(Path("/d"))
    for operation in operations:
        disk.apply(operation)
    found = []
    for number, case in enumerate(disk.cases()):
        target = tmp_path / str(number)
        target.mkdir()
        rebuild(disk.left(case), target)
        found.append({path.name: path.read_bytes() for path in target.rglob("*") if path.is_file()})
    return found


def operation(kind: str, path: str = "/d/f", other: str = "", offset: int = 0) -> Operation:
    return Operation(kind, offset, path, other, b"")


WRITTEN = [operation("C"), write("/d/f", b"one")]
SAFE = [*WRITTEN, operation("S"), operation("S", "/d")]


def test_what_was_synced_is_there_in_every_case(tmp_path: Path) -> None:
    assert all(files == {"f": b"one"} for files in left(SAFE, tmp_path))


@pytest.mark.parametrize("missing", [operation("S"), operation("S", "/d")])
def test_what_was_not_synced_is_lost_in_some_case(missing: Operation, tmp_path: Path) -> None:
    found = left([item for item in SAFE if item != missing], tmp_path)
    assert {"f": b"one"} in found
    assert ({"f": b""} if missing.path == "/d/f" else {}) in found


def test_a_rename_may_come_before_the_bytes_of_its_file(tmp_path: Path) -> None:
    found = left([*SAFE, operation("C", "/d/t"), write("/d/t", b"two"), operation("R", "/d/t", "/d/f")], tmp_path)
    assert {"f": b"one"} in found
    assert {"f": b"two"} in found
    assert {"f": b""} in found


def test_a_write_is_torn_between_sectors(tmp_path: Path) -> None:
    found = left([*SAFE, write("/d/f", b"x" * 1024, offset=256)], tmp_path)
    begun = b"one" + bytes(253)
    assert {"f": begun + b"x" * 256} in found
    assert {"f": begun + b"x" * 768} in found
    assert all(len(files["f"]) in (3, 512, 1024, 1280) for files in found)
