"""Every fault at every operation of every workload, and every power failure after each: run under the shim.

    LD_PRELOAD=faults.so python tests/faults/positions.py FOLDER WORKLOAD...

Prints one JSON object with how many positions were tried and how they went. An AssertionError says what does not hold.
"""

import errno
import json
import logging
import os
import shutil
import signal
import sys
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from faults.power_loss import prefixes, write
from faults.shim import Fault, Shim, recorded
from faults.workloads import WORKLOADS, Workload

from service.errors import ServiceError

PASSING = ((Fault.FAIL, errno.EIO), (Fault.FAIL, errno.ENOSPC), (Fault.TEAR, errno.EIO), (Fault.TEAR, errno.ENOSPC))
LASTING = ((Fault.FAIL_FROM_HERE, errno.EIO), (Fault.FAIL_FROM_HERE, errno.ENOSPC), (Fault.FAIL_FROM_HERE, errno.EROFS))
DEADLY = (Fault.KILL, Fault.TEAR_AND_KILL)


def fails(attempt: Callable[[], object], root: Path) -> bool:
    """Whether `attempt` fails, which it has to tell in one sentence that names its place."""
    try:
        attempt()
    except ServiceError as error:
        told = str(error)
    else:
        return False
    assert "\n" not in told, told
    assert str(root.parent) in told, told
    return True


class Trial:
    """Tries one workload with the shim, each time in an empty folder."""

    def __init__(self, shim: Shim, make: Callable[[Path], Workload], folder: Path) -> None:
        self._shim, self._make, self._folder = shim, make, folder
        self.counts: Counter[str] = Counter()

    def _fresh(self) -> tuple[Path, Workload]:
        shutil.rmtree(self._folder, ignore_errors=True)
        root = self._folder / "state"
        root.mkdir(parents=True)
        self._shim.watch(root)
        return root, self._make(root)

    def operations(self) -> int:
        """How many operations the workload has, recorded for `power_failures`."""
        root, workload = self._fresh()
        self._shim.record(self._folder / "record")
        self._shim.arm(-1, Fault.FAIL)
        for number, step in enumerate(workload.steps, start=1):
            step()
            self._shim.mark(number)
        self._shim.record(None)
        count = self._shim.count
        workload.verify(root, len(workload.steps), exactly=True)
        return count

    def survives(self, position: int, fault: Fault, number: int, lasting: bool) -> None:
        """A fault at `position` is told in a sentence, and once it is gone everything goes on."""
        root, workload = self._fresh()
        self._shim.arm(position, fault, number)
        told = 0
        for step in workload.steps:
            if fails(step, root):
                told += 1
                if lasting:
                    self._shim.disarm()
                step()
        assert self._shim.hits, f"operation {position} was not reached"
        self._shim.disarm()
        self.counts["told" if told else "not noticed"] += 1
        workload.verify(root, len(workload.steps), exactly=True)

    def dropped(self, position: int) -> None:
        """An operation that only seems to be done may lose something, which is told, but never changes a bit."""
        root, workload = self._fresh()
        self._shim.arm(position, Fault.DROP)
        told = any(fails(step, root) for step in workload.steps)
        self._shim.disarm()
        del workload.steps
        told |= fails(lambda: workload.verify(root, 0, exactly=False), root)
        self.counts["dropped and told" if told else "dropped"] += 1

    def killed(self, position: int, fault: Fault) -> None:
        """After a death at `position` everything that was acknowledged is there."""
        root, workload = self._fresh()
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            code = 0
            try:
                self._shim.arm(position, fault)
                for step in workload.steps:
                    step()
                    os.write(writer, b".")
            except BaseException:
                traceback.print_exc()
                code = 1
            os._exit(code)
        os.close(writer)
        with os.fdopen(reader, "rb") as pipe:
            done = len(pipe.read())
        _, status = os.waitpid(child, 0)
        assert os.waitstatus_to_exitcode(status) == 137, f"operation {position} did not end the process"
        self._shim.disarm()
        self.counts["killed"] += 1
        workload.verify(root, done, exactly=True)

    def power_failures(self) -> None:
        """After a power failure behind every operation everything that was acknowledged is there."""
        root, target = self._folder / "state", self._folder / "after"
        operations = list(recorded(self._folder / "record"))
        workload = self._make(root)
        self._shim.watch(Path("/nowhere"))
        seen = set[tuple[int, frozenset[tuple[str, bytes | None]]]]()
        for number, (done, disk) in enumerate(prefixes(root, operations)):
            for case in disk.cases():
                left = disk.left(case)
                self.counts["power failures"] += 1
                # Most ways to fail leave the same.
                if (found := (done, frozenset(left.items()))) in seen:
                    continue
                seen.add(found)
                shutil.rmtree(target, ignore_errors=True)
                target.mkdir()
                write(left, target)
                try:
                    workload.verify(target, done, exactly=True)
                except Exception as error:
                    raise AssertionError(f"power failure behind operation {number}, {case.name}: {error}") from error


def try_everything(shim: Shim, name: str, folder: Path, stride: int) -> dict[str, int]:
    """All faults at every `stride`-th position of a workload and at its last, and power failures at all of them; how
    many there were of each outcome."""
    trial = Trial(shim, WORKLOADS[name], folder / name)
    operations = trial.operations()
    trial.power_failures()
    positions = sorted({*range(0, operations, stride), operations - 1})
    for position in positions:
        try:
            for fault, number in PASSING:
                trial.survives(position, fault, number, lasting=False)
            for fault, number in LASTING:
                trial.survives(position, fault, number, lasting=True)
            for fault in DEADLY:
                trial.killed(position, fault)
            trial.dropped(position)
        except Exception as error:
            raise AssertionError(f"{name}, operation {position} of {operations}: {error!r}") from error
    return {"operations": operations, "positions": len(positions), "tries": sum(trial.counts.values()), **trial.counts}


if __name__ == "__main__":
    # What the log says of torn ends is right, and many times a second.
    logging.disable(logging.CRITICAL)
    # Otherwise asyncio exchanges Python's handler at each of many thousand steps, which takes a tenth of the time.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    folder, stride, *names = sys.argv[1:]
    print(json.dumps({name: try_everything(Shim(), name, Path(folder), int(stride)) for name in names}))
