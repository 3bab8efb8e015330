"""A PostgreSQL server as a process of its own, and connections to it that are cut where it matters."""

import os
import pwd
import select
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from support.processes import Program, program

_SOCKET = ".s.PGSQL.5432"


def _program(name: str) -> str:
    """Where a program of the newest PostgreSQL is."""
    versions = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda folder: float(folder.parent.name))
    return program(name, "postgresql", first=os.pathsep.join(map(str, reversed(versions))))


class Server:
    """A server on a Unix socket in a folder of its own, which can be stopped, killed and started again."""

    def __init__(self, *settings: str, fsync: bool = False) -> None:
        """`settings` are of the form name=value."""
        pytest.importorskip("psycopg", reason="psycopg is not installed; say: make .venv/.fleet")
        self._postgres, initdb = _program("postgres"), _program("initdb")
        # pytest's own folders let nobody else in, and the server will not run as root.
        self.folder = Path(tempfile.mkdtemp(prefix="thermogate-pg-", dir="/tmp"))
        self._log = self.folder / "log"
        self._as_owner = _as_owner(self.folder)
        self._settings = [f"fsync={'on' if fsync else 'off'}", "listen_addresses=", "shared_buffers=32MB", *settings]
        self._running: Program | None = None
        self._starting = ThreadPoolExecutor(1)
        """The thread that starts it: it ends with that."""
        self.environment: dict[str, str] = {}
        """Added to that of the server."""
        words = ["-D", str(self.folder / "data"), "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C", "-N"]
        self._done(initdb, *words)

    @property
    def connection(self) -> str:
        """How a client names the server's database."""
        return f"host={self.folder} user=postgres dbname=postgres"

    def start(self) -> None:
        """Returns once it answers."""
        arguments = [argument for setting in self._settings for argument in ("-c", setting)]
        words = [*self._as_owner, self._postgres, "-D", self.folder / "data", "-k", self.folder, *arguments]
        options = {"cwd": self.folder, "env": os.environ | self.environment}
        self._running = self._starting.submit(Program, words, self._log, **options).result()
        self._running.wait_for(self._answers)

    def _answers(self) -> bool:
        import psycopg

        try:
            psycopg.connect(self.connection).close()
        except psycopg.OperationalError:
            return False
        return True

    def is_running(self) -> bool:
        return self._running is not None

    def stop(self, sign: signal.Signals = signal.SIGINT) -> None:
        """End it: SIGINT disconnects everybody, SIGQUIT is as if the machine had failed."""
        if self._running is not None:
            with suppress(ProcessLookupError):
                self._running.terminate(sign)
            self._running = None

    def run(self, *statements: str) -> list[tuple[Any, ...]]:
        """Run statements, each of its own; the rows of the last one."""
        import psycopg

        with psycopg.connect(self.connection, autocommit=True) as connection:
            cursor = connection.cursor()
            for statement in statements:
                cursor.execute(statement.encode())
            return cursor.fetchall() if cursor.description else []

    def disconnect(self) -> None:
        """End the sessions of the stores; they make new ones."""
        self.run("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'thermogate'")

    def command(self, name: str, *arguments: str) -> str:
        """Run one of PostgreSQL's programs as the owner of the server; what it prints."""
        return self._done(_program(name), "-h", str(self.folder), "-U", "postgres", *arguments)

    def _done(self, *words: str) -> str:
        done = subprocess.run([*self._as_owner, *words], cwd=self.folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def log(self) -> str:
        return self._log.read_text(encoding="utf-8", errors="replace")

    def remove(self) -> None:
        self.stop(signal.SIGQUIT)
        self._starting.shutdown()
        shutil.rmtree(self.folder, ignore_errors=True)


@contextmanager
def server(*settings: str, fsync: bool = False) -> Iterator[Server]:
    running = Server(*settings, fsync=fsync)
    try:
        running.start()
        yield running
    finally:
        running.remove()


def _as_owner(folder: Path) -> Sequence[str]:
    """What a program of the server's begins with; the `folder` is made its owner's."""
    # It does not outlive the tests, however they end.
    setpriv = program("setpriv", "util-linux")
    words = [setpriv, "--pdeathsig=QUIT"]
    if os.geteuid() == 0:
        try:
            owner = pwd.getpwnam("postgres")
        except KeyError:
            pytest.skip("there is no user postgres; on Debian: apt-get install postgresql")
        os.chown(folder, owner.pw_uid, owner.pw_gid)
        words = [setpriv, f"--reuid={owner.pw_uid}", f"--regid={owner.pw_gid}", "--clear-groups", "--pdeathsig=QUIT"]
    return words


class Cutting:
    """A relay to a server, which passes the next messages that hold `word` on and then cuts the connection, before any
    answer comes back."""

    def __init__(self, folder: Path, to: Server) -> None:
        self.connection = f"host={folder} user=postgres dbname=postgres sslmode=disable"
        self.word: bytes | None = None
        """The connection is cut after this; once."""
        self.cuts = 0
        self._to = str(to.folder / _SOCKET)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(folder / _SOCKET))
        self._listener.listen()
        self._clients: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self._accepting = threading.Thread(target=self._accept)
        self._accepting.start()

    def close(self) -> None:
        """Cut every connection that is left."""
        for end in (self._listener, *self._clients):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for thread in (self._accepting, *self._threads):
            thread.join()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self._clients.append(client)
            thread = threading.Thread(target=self._relay, args=(client,))
            thread.start()
            self._threads.append(thread)

    def _relay(self, client: socket.socket) -> None:
        # Either side may go away at any moment.
        with suppress(OSError), client, socket.socket(socket.AF_UNIX) as server_side:
            server_side.connect(self._to)
            while True:
                ready, _, _ = select.select([client, server_side], [], [])
                for one, other in ((client, server_side), (server_side, client)):
                    if one not in ready:
                        continue
                    content = one.recv(2**16)
                    if not content:
                        return
                    other.sendall(content)
                    if one is client and self.word is not None and self.word in content:
                        self.word = None
                        self.cuts += 1
                        # The server has done it when it answers, and nobody hears of it.
                        server_side.recv(2**16)
                        return
