"""Programs in processes of their own, each with what it says in a file."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Self

import pytest
from support.forked import Forked, forking
from support.waiting import PATIENCE, Found, wait_until


def program(name: str, package: str, first: str = "") -> str:
    """Where a program is that a `package` of Debian brings, in folders `first` or the usual ones; skips without it."""
    folders = filter(None, [first, os.environ.get("PATH"), "/usr/sbin", "/usr/local/sbin"])
    found = shutil.which(name, path=os.pathsep.join(folders))
    if found is None:
        pytest.skip(f"{name} is not installed; on Debian: apt-get install {package}")
    return found


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def listens(port: int) -> bool:
    """Whether anybody accepts connections there."""
    with socket.socket() as attempt:
        return attempt.connect_ex(("127.0.0.1", port)) == 0


def fetch(
    url: str, content: bytes | None = None, method: str | None = None, timeout: float = PATIENCE, **headers: str
) -> tuple[int, str]:
    """Status and text of the answer to a GET, or to a POST of `content`; `_` in the name of a header is `-`. Raises
    OSError where nobody answers."""
    sent = {name.replace("_", "-"): value for name, value in headers.items()}
    try:
        with urllib.request.urlopen(
            urllib.request.Request(url, content, sent, method=method), timeout=timeout
        ) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


THERMOGATE = Path(sys.executable).with_name("thermogate")


class Program:
    """A program that is started at once; a context manager that never leaves its process behind."""

    forks = False
    """Whether `thermogate` is forked with everything imported, as in tests; the programs of the slow targets start it
    as a user does."""

    def __init__(self, command: Sequence[object], log: Path, **options: Any) -> None:
        """`options` are those of Popen."""
        self._log, words = log, [*map(str, command)]
        self.process: subprocess.Popen[bytes] | Forked
        if self.forks and command[0] == THERMOGATE and options.keys() <= {"env"}:
            self.process = Forked(words, log, options.get("env", os.environ))
        else:
            with log.open("a") as stream:
                self.process = subprocess.Popen(words, stdout=stream, stderr=stream, **options)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.kill()

    def log(self) -> str:
        """What it has said."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def wait_for(self, found: Callable[[], Found], patience: float = PATIENCE) -> Found:
        """What `found` returns, once that is true; fails if the program ends before."""

        def found_yet() -> Found:
            result = found()
            assert result or self.process.poll() is None, self.log()
            return result

        return wait_until(found_yet, self.log, patience)

    def says(self, pattern: str, patience: float = PATIENCE) -> re.Match[str]:
        """Where its log matches, once it does."""
        found = self.wait_for(lambda: re.search(pattern, self.log()), patience)
        assert found is not None
        return found

    def terminate(self, sign: int = signal.SIGTERM) -> int:
        """Exit code after an orderly stop, which may take as long as on a very busy machine."""
        self.process.send_signal(sign)
        return self.process.wait(PATIENCE)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@contextmanager
def beside(serve: Callable[..., None], *arguments: object) -> Iterator[Connection]:
    """`serve` with `arguments` and a pipe in a process of its own; the other end of the pipe."""
    context = forking()
    here, there = context.Pipe()
    process = context.Process(target=serve, args=(*arguments, there), daemon=True)
    process.start()
    try:
        yield here
    finally:
        process.terminate()
        process.join()
