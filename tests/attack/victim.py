"""A live daemon under attack, and what it costs: answers of /healthz, the event loop, memory, live intervals."""

from __future__ import annotations

import math
import multiprocessing
import re
import socket
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

from support.harness import Daemon

HOLD_SECONDS = 0.25
"""How long no client may hold the event loop."""

MEMORY_MB = 100.0
"""What any one client may take beyond what the daemon has at rest."""


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

    def connect(self, timeout: float = 30.0) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout)

    def ask(self, request: bytes, timeout: float = 60.0) -> Answer:
        """The answer to `request` on a connection of its own, which the request should ask to close."""
        with self.connect(timeout) as connection:
            connection.sendall(request)
            content = b""
            try:
                while piece := connection.recv(2**16):
                    content += piece
            except OSError:
                pass
        head, _, body = content.partition(b"\r\n\r\n")
        found = re.match(rb"HTTP/1.1 (\d{3})", head)
        return Answer(int(found[1]) if found else 0, head.decode("latin-1"), body)

    def get(self, path: str, **headers: str) -> Answer:
        """The answer to a GET."""
        lines = [f"GET {path} HTTP/1.1", "Host: localhost", "Connection: close"]
        return self.ask(_head(lines, headers, self.key))

    def post(
        self, path: str, body: bytes, key: str | None = None, kind: str = "application/json", **headers: str
    ) -> Answer:
        """The answer to a POST of JSON, or of what else `kind` names, with an API key if one is given."""
        lines = [f"POST {path} HTTP/1.1", "Host: localhost", "Connection: close", f"Content-Type: {kind}"]
        return self.ask(_head([*lines, f"Content-Length: {len(body)}"], headers, key) + body)


def _head(lines: list[str], headers: Mapping[str, str], key: str | None) -> bytes:
    """The head of a request with `lines`, further headers (_ for -) and a key."""
    lines = [*lines, *(f"{name.replace('_', '-')}: {value}" for name, value in headers.items())]
    if key is not None:
        lines.append(f"Authorization: Bearer {key}")
    return "".join(f"{line}\r\n" for line in [*lines, ""]).encode()


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
        self.target = Target(int(daemon.url().rpartition(":")[2]), daemon.key)
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
        assert found is not None
        return int(found[1]) / 1024

    def _holds(self) -> int:
        text = self.target.get("/metrics").body.decode()
        counts = {
            le: float(count)
            for le, count in re.findall(r'thermogate_event_loop_delay_seconds_bucket\{le="([^"]+)"\} (\S+)', text)
        }
        within = max(count for le, count in counts.items() if float(le) <= HOLD_SECONDS)
        return int(counts["+Inf"] - within)

    def _lost(self, begin: float, end: float) -> int:
        """Intervals of the live zone in that time which no reading was taken in."""
        time.sleep(3.0)
        rows = self.daemon.history(self._zone)
        measured = {row["time"][:19] for row in rows if row["y"] is not None}
        wanted = {time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(second)) for second in range(int(begin) + 1, int(end))}
        return len(wanted - measured)
