"""Thermogate as processes of their own, to be measured from outside."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from replay.errors import MeasurementError

COMMAND = (sys.executable, "-m", "service")
"""The command `thermogate` of this very installation."""

Figure = TypeVar("Figure", int, float)

_POLL_SECONDS = 0.005
_STOP_SECONDS = 60.0


class DaemonProcess:
    """`thermogate run`; a context manager that never leaves a process behind."""

    def __init__(
        self,
        config: Path,
        log: Path,
        *,
        command: Sequence[str] = ("run",),
        options: Sequence[str] = (),
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Starts it, or another `command` that runs zones; `environment` is added to this process's own, `log` takes
        what it says."""
        self._log = log
        self.began = time.monotonic()
        with log.open("w", encoding="utf-8") as stream:
            self.process = subprocess.Popen(
                [*COMMAND, *command, str(config), *options],
                stdout=stream,
                stderr=stream,
                env={**os.environ, **(environment or {})},
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def url(self, timeout: float = 300.0) -> str:
        """The address it serves REST on, once it does; MeasurementError if it ends or takes longer than `timeout` s."""
        while time.monotonic() < self.began + timeout:
            found = re.search(r"serving on (http://\S+)", self.log())
            if found:
                return found[1]
            self.check()
            time.sleep(_POLL_SECONDS)
        raise MeasurementError(f"the daemon does not serve after {timeout:g} s; its log ends with: {self._last_line()}")

    def check(self) -> None:
        """MeasurementError if it has ended."""
        if self.process.poll() is not None:
            raise MeasurementError(
                f"the daemon has ended with exit code {self.process.returncode}; its log ends with: {self._last_line()}"
            )

    def log(self) -> str:
        """What it has said so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def memory(self) -> int:
        """Resident memory now, bytes."""
        return resident_bytes(self.process.pid)

    def cpu_seconds(self) -> float:
        """Processor time used so far, over all threads."""
        return _cpu_seconds(self.process.pid)

    def tree_cpu_seconds(self) -> float:
        """Processor time used so far by it and every process below it that is there now."""
        return _total(_cpu_seconds, tree(self.process.pid))

    def tree_resident_bytes(self) -> int:
        """Resident memory of it and every process below it now; what they share counts for each of them."""
        return _total(resident_bytes, tree(self.process.pid))

    def stop(self) -> float:
        """Stop it in order; how many s that took. MeasurementError where it does not end well."""
        began = time.monotonic()
        self.process.terminate()
        try:
            code = self.process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            raise MeasurementError(f"the daemon does not stop within {_STOP_SECONDS:g} s; see {self._log}") from None
        if code != 0:
            raise MeasurementError(f"the daemon stopped with exit code {code}; its log: {self._last_line()}")
        return time.monotonic() - began

    def _last_line(self) -> str:
        return (self.log().strip().splitlines() or ["(nothing)"])[-1]


def tree(process: int) -> list[int]:
    """A process and all below it, the uppermost first."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        # Processes come and go meanwhile.
        if entry.name.isdecimal():
            with suppress(OSError):
                children.setdefault(int(_stat(int(entry.name))[1]), []).append(int(entry.name))
    found = [process]
    for each in found:
        found += children.get(each, [])
    return found


def _total(figure: Callable[[int], Figure], processes: Iterable[int]) -> Figure | int:
    """The sum over the processes that have not ended meanwhile."""
    total: Figure | int = 0
    for process in processes:
        with suppress(OSError):
            total += figure(process)
    return total


def _cpu_seconds(process: int) -> float:
    stat = _stat(process)
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


def _stat(process: int) -> list[str]:
    """The figures of /proc/PID/stat after the name of the program."""
    return Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()


def resident_bytes(process: int) -> int:
    """Resident memory of a process now."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
