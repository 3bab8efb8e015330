"""Every single write, sync, rename and removal of the store fails, tears, is dropped, or is the last before a crash.

Of a workload's operations every sixth has its turn here; `make faults` tries them all.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from faults import shim
from faults.power_loss import CASES, Disk
from faults.power_loss import write as rebuild
from faults.shim import Operation

STRIDE = 1 if os.environ.get("FAULTS") == "all" else 6
WORKLOADS = ("checkpoints", "journal", "reset", "restore", "set back")
SCRIPT = Path(shim.__file__).with_name("positions.py")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    built = shim.build(tmp_path_factory.mktemp("shim"))
    if built is None:
        pytest.skip("there is no C compiler to build the failing file layer with")
    return built


@pytest.fixture(scope="module")
def counted(library: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, int]]:
    """How all workloads went, which one process tries in a folder in memory where there is one: thousands of syncs to a
    disk take minutes."""
    memory = Path("/dev/shm")
    where = memory if os.access(memory, os.W_OK) else tmp_path_factory.mktemp("faults")
    with tempfile.TemporaryDirectory(dir=where) as folder:
        done = subprocess.run(
            [sys.executable, str(SCRIPT), folder, str(STRIDE), *WORKLOADS],
            env=os.environ | {"LD_PRELOAD": str(library)},
            capture_output=True,
            text=True,
            timeout=9000,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("workload", WORKLOADS)
def test_nothing_acknowledged_is_lost_at_any_position(workload: str, counted: dict[str, dict[str, int]]) -> None:
    counts = counted[workload]
    # Seven faults that pass or last, two deaths and one drop at each position, and the power failures between them.
    assert counts["operations"] > 30
    assert counts["positions"] >= counts["operations"] / STRIDE
    assert counts["tries"] == 10 * counts["positions"] + counts["power failures"]
    assert counts["killed"] == 2 * counts["positions"]
    assert counts["power failures"] > len(CASES) * counts["operations"]
    assert counts["told"] > 5 * counts["positions"], "faults are told, not passed over"


def operation(kind: str, path: str = "/d/f", other: str = "", offset: int = 0, data: bytes = b"") -> Operation:
    return Operation(kind, offset, path, other, data)


SYNCED, NAMED = operation("S"), operation("S", "/d")
WRITTEN = [operation("C"), operation("W", data=b"one")]
RENAMED = [operation("C", "/d/t"), operation("W", "/d/t", data=b"two"), operation("R", "/d/t", "/d/f")]
LONGER, BEGUN = operation("W", offset=256, data=b"x" * 1024), b"one" + bytes(253)


@pytest.mark.parametrize(
    ("operations", "found"),
    [
        ([*WRITTEN, SYNCED, NAMED], {b"one"}),
        ([*WRITTEN, NAMED], {b"one", b""}),
        ([*WRITTEN, SYNCED], {b"one", None}),
        # A rename may come before the bytes of its file.
        ([*WRITTEN, SYNCED, NAMED, *RENAMED], {b"one", b"two", b""}),
        # A write is torn between sectors.
        ([*WRITTEN, SYNCED, NAMED, LONGER], {b"one", *(BEGUN + b"x" * length for length in (256, 768, 1024))}),
    ],
)
def test_what_was_not_synced_may_be_lost_and_nothing_else(
    operations: list[Operation], found: set[bytes | None], tmp_path: Path
) -> None:
    disk = Disk(Path("/d"))
    for each in operations:
        disk.apply(each)
    left = set[bytes | None]()
    for number, case in enumerate(disk.cases()):
        target = tmp_path / str(number)
        target.mkdir()
        rebuild(disk.left(case), target)
        left.add((target / "f").read_bytes() if (target / "f").exists() else None)
    assert left == found
