"""Thermogate as processes of their own, to be measured from outside."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from replay.errors import MeasurementError

COMMAND = (sys.executable, "-m", "service")
"""The command `thermogate` of this very installation."""

_POLL_SECONDS = 0.005
_STOP_SECONDS = 60.0


class DaemonProcess:
    """`thermogate run`; a context manager that never leaves a process behind."""

    def __init__(
        self, config: Path, log: Path, *, options: Sequence[str] = (), environment: Mapping[str, str] | None = None
    ) -> None:
        """Starts it; `environment` is added to this process's own, `log` takes what it says."""
        self._log = log
        self.began = time.monotonic()
        with log.open("w", encoding="utf-8") as stream:
            self.process = subprocess.Popen(
                [*COMMAND, "run", str(config), *options],
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
        stat = Path(f"/proc/{self.process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")

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


def resident_bytes(process: int) -> int:
    """Resident memory of a process now."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
