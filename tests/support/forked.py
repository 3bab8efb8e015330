"""Processes that are forked from one which has imported the daemon: most of a start is importing."""

import atexit
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from io import TextIOWrapper
from multiprocessing.context import ForkServerContext
from pathlib import Path

IMPORTED = ["service.daemon.run", "replay.bms.serving", "replay.recorded.learning"]


def forking() -> ForkServerContext:
    """Processes that have imported the daemon, a simulated building and a learning zone as soon as they begin."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(IMPORTED)
    return context


class Forked:
    """A `command` that is one of `thermogate`, with the part of Popen's interface that tests use. What it says goes to
    `log`."""

    def __init__(self, command: Sequence[str], log: Path, environment: Mapping[str, str]) -> None:
        self.args = command
        log.touch()
        self._process = forking().Process(target=_run, args=(command, log, dict(environment)), daemon=True)
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        """The exit code, once there is one; that of a process that was killed is negative."""
        return self._process.exitcode

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if timeout is not None and self.returncode is None:
            raise subprocess.TimeoutExpired(self.args, timeout)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self._process.terminate()

    def kill(self) -> None:
        self._process.kill()


def _run(command: Sequence[str], log: Path, environment: Mapping[str, str]) -> None:
    from service.cli.main import main

    with log.open("ab") as stream:
        for descriptor in (1, 2):
            os.dup2(stream.fileno(), descriptor)
    assert isinstance(sys.stdout, TextIOWrapper)
    sys.stdout.reconfigure(line_buffering=True)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [*command]
    code = main()
    # Processes of this kind end without, and lines that were covered would be lost.
    atexit._run_exitfuncs()
    sys.exit(code)
