"""A live daemon under attack, and what it costs: answers of /healthz, the event loop, memory, live intervals."""

import itertools
import math
import multiprocessing
import os
import re
import socket
import ssl
import time
from collections import Counter
from collections.abc import Callable, Sequence, Set
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

from support.certificates import make_pair
from support.harness import Daemon
from support.observed import DELAY, scrape

HOLD_SECONDS = 0.25
"""How long no client may hold the event loop."""

JSON = "application/json"

MEMORY_MB = 100.0
"""What any one client may take beyond what the daemon has at rest."""


TLS: dict[str, object] = {}
"""Settings that daemons are served with over TLS; none in the clear."""


def use_tls(folder: Path) -> None:
    """Serve daemons over TLS from now on, with a certificate in `folder` that this process trusts."""
    pair = make_pair(folder)
    TLS.update({"http.certificate": str(pair.certificate), "http.private_key": str(pair.private_key)})
    os.environ["SSL_CERT_FILE"] = str(pair.certificate)


def served(config: Path, folder: Path) -> Daemon:
    """The daemon of `config`, whose log is in `folder`."""
    return Daemon(config, folder / "log", TLS)


class Answer(NamedTuple):
    """An answer as an attacker sees it."""

    status: int
    head: str
    body: bytes


class Target(NamedTuple):
    """Where the daemon listens; what attackers in processes of their own need to know."""

    port: int
    key: str | None = None
    """An API key to read with."""

    @classmethod
    def of(cls, daemon: Daemon) -> "Target":
        """Where `daemon` listens."""
        return cls(int(daemon.url().rpartition(":")[2]), daemon.key)

    def connect(self, timeout: float = 30.0) -> socket.socket:
        connection = socket.create_connection(("127.0.0.1", self.port), timeout)
        return ssl.create_default_context().wrap_socket(connection, server_hostname="localhost") if TLS else connection

    def ask(self, request: bytes, timeout: float = 60.0) -> Answer:
        """The answer to `request` on a connection of its own, which the request should ask to close."""
        content = b""
        # What is refused or cut off is an answer without a status.
        with suppress(OSError), self.connect(timeout) as connection:
            connection.sendall(request)
            while piece := connection.recv(2**16):
                content += piece
        head, _, body = content.partition(b"\r\n\r\n")
        found = re.match(rb"HTTP/1.1 (\d{3})", head)
        return Answer(int(found[1]) if found else 0, head.decode("latin-1"), body)

    def request(
        self, path: str, body: bytes | None = None, key: str | None = None, kind: str = JSON, **headers: str
    ) -> bytes:
        """A GET with the target's key, or a POST with another one; in the names of `headers`, _ stands for -."""
        lines = ["Host: localhost", "Connection: close"]
        lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
        if body is not None:
            lines += [f"Content-Type: {kind}", f"Content-Length: {len(body)}"]
        elif key is None:
            key = self.key
        if key is not None:
            lines.append(f"Authorization: Bearer {key}")
        head = [f"{'GET' if body is None else 'POST'} {path} HTTP/1.1", *lines, ""]
        return "".join(f"{line}\r\n" for line in head).encode() + (body or b"")

    def get(self, path: str, **headers: str) -> Answer:
        """The answer to a GET."""
        return self.ask(self.request(path, **headers))

    def post(self, path: str, body: bytes, key: str | None = None, **headers: str) -> Answer:
        """The answer to a POST of JSON."""
        return self.ask(self.request(path, body, key, **headers))


def hammered(target: Target, requests: Sequence[bytes], seconds: float, expected: Set[int]) -> str:
    """The answers, which have `expected` statuses, to `requests` again and again on eight connections. In a process of
    its own, for this one may be the device that the daemon reads."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("fork")) as process:
        answers = process.submit(_hammer, target, requests, seconds).result()
    seen = Counter(status for status, _ in answers)
    # 0: there was no answer within a minute, which on a slow machine says nothing.
    assert seen.keys() <= {0, *expected}, seen
    told = ", ".join(f"{count} times {status}" for status, count in sorted(seen.items()))
    return f"{told}; up to {max(size for _, size in answers) / 2**20:.1f} MB each"


def _hammer(target: Target, requests: Sequence[bytes], seconds: float) -> list[tuple[int, int]]:
    """Status and size of every answer."""
    answers: list[tuple[int, int]] = []
    order, end = itertools.cycle(requests), time.monotonic() + seconds

    def ask() -> None:
        while time.monotonic() < end:
            answer = target.ask(next(order))
            answers.append((answer.status, len(answer.body)))

    with ThreadPoolExecutor(8) as pool:
        for done in [pool.submit(ask) for _ in range(8)]:
            done.result()
    return answers


class Cost(NamedTuple):
    """What an attack cost the daemon."""

    seconds: float
    waited: float
    """How long the thread of the event loop was ready to run and got no processor, s."""
    p99: float
    """Of the answers of /healthz, s; infinite where more than one in a hundred was refused."""
    longest: float
    """Of the answers of /healthz, s."""
    refused: int
    """How often /healthz was."""
    holds: int
    """How often the loop was late by more than HOLD_SECONDS."""
    memory: float
    """Peak beyond rest, MB."""
    lost: int
    """Live intervals without a reading."""


def _watch(target: Target, stop: Connection) -> None:
    """In a process of its own: how long /healthz takes, twenty times a second; infinitely long if it is refused."""
    latencies = []
    while not stop.poll(0.05):
        begun = time.monotonic()
        try:
            answered = target.get("/healthz").status == 200
        except OSError:
            answered = False
        latencies.append(time.monotonic() - begun if answered else math.inf)
    stop.send(latencies)


class Victim:
    """`daemon` with its figures at rest; `zone` is read live, a sample a second."""

    def __init__(self, daemon: Daemon, zone: str) -> None:
        self.daemon, self._zone = daemon, zone
        self.target = Target.of(daemon)
        self.rest = self._memory("VmRSS")

    def under(self, attack: Callable[[Target], str]) -> tuple[str, Cost]:
        """What `attack` has to report, and what it cost."""
        process = self.daemon.process.pid
        Path(f"/proc/{process}/clear_refs").write_text("5")
        holds, waited, (mine, other) = self._holds(), self._waited(), multiprocessing.Pipe()
        context = multiprocessing.get_context("fork")
        watch = context.Process(target=_watch, args=(self.target, other))
        watch.start()
        begun, wall = time.monotonic(), time.time()
        try:
            note = attack(self.target)
        finally:
            seconds = time.monotonic() - begun
            mine.send(None)
            latencies = mine.recv()
            watch.join()
        waited = self._waited() - waited
        latencies.sort()
        answered = [one for one in latencies if not math.isinf(one)]
        p99 = latencies[int(0.99 * (len(latencies) - 1))] if latencies else math.nan
        times = p99, max(answered, default=math.nan), len(latencies) - len(answered)
        found = self._holds() - holds, self._memory("VmHWM") - self.rest, self._lost(wall, wall + seconds)
        return note, Cost(seconds, waited, *times, *found)

    def _waited(self) -> float:
        # The kernel counts the time on a processor, that in the queue for one, and the turns.
        process = self.daemon.process.pid
        return int(Path(f"/proc/{process}/task/{process}/schedstat").read_text().split()[1]) / 1e9

    def _memory(self, what: str) -> float:
        status = Path(f"/proc/{self.daemon.process.pid}/status").read_text()
        found = re.search(rf"{what}:\s+(\d+) kB", status)
        return int(found[1]) / 1024

    def _holds(self) -> int:
        found = scrape(self.daemon)
        return int(found[f"{DELAY}inf"] - found[f"{DELAY}{HOLD_SECONDS:g}"])

    def _lost(self, begin: float, end: float) -> int:
        """Intervals of the live zone in that time which no reading was taken in."""
        time.sleep(3.0)
        rows = self.daemon.history(self._zone)
        measured = {row["time"][:19] for row in rows if row["y"] is not None}
        wanted = {time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(second)) for second in range(int(begin) + 1, int(end))}
        return len(wanted - measured)
