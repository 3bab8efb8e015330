"""Attacks over HTTP, none of them with a key. Each returns what it saw; AssertionError where something gave way."""

import asyncio
import contextlib
import json
import socket
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from attack.victim import Target, hammered
from support.fake_zones import make_update

from service.store.store import Store

SECONDS = 15.0
ROWS = 20_000
"""As many rows of the history as one request may ask for."""

TINY = b"1\r\na\r\n" * 2000
HEAD = "Host: localhost\r\nContent-Type: application/json\r\n"


def _flood(target: Target, begin: bytes, endless: bytes, count: int, seconds: float = SECONDS) -> tuple[int, int]:
    """`count` connections that send `endless` after `begin` as fast as they are let; bytes and connections."""
    sent = opened = 0
    end = time.monotonic() + seconds
    connections: list[socket.socket] = []
    try:
        while time.monotonic() < end:
            while len(connections) < count:
                with contextlib.suppress(OSError):
                    connection = target.connect(5)
                    opened += 1
                    connection.sendall(begin)
                    connection.settimeout(0.001)
                    connections.append(connection)
            for connection in list(connections):
                try:
                    sent += connection.send(endless)
                except TimeoutError:
                    continue
                except OSError:
                    connections.remove(connection)
                    connection.close()
    finally:
        for connection in connections:
            connection.close()
    return sent, opened


def _endless(path: str, piece: bytes, count: int) -> Callable[[Target], str]:
    """`count` connections with a body that is `piece` over and over."""
    begin = f"POST {path} HTTP/1.1\r\n{HEAD}Transfer-Encoding: chunked\r\n\r\n".encode()

    def attack(target: Target) -> str:
        sent, opened = _flood(target, begin, piece, count)
        return f"{sent / 2**20:.0f} MB on {opened} connections"

    return attack


def _held(target: Target, beginnings: Sequence[bytes], seconds: float) -> str:
    """A connection for each of `beginnings`, none of which goes on."""
    held = []
    for begin in beginnings:
        with contextlib.suppress(OSError):
            connection = target.connect(5)
            held.append(connection)
            connection.sendall(begin)
    time.sleep(seconds)
    for connection in held:
        connection.close()
    return f"{len(held)} connections"


def unfinished_bodies(target: Target) -> str:
    """200 bodies of nearly 1 MB that are never finished."""
    begin = f"POST /zones/zone-one/forecast HTTP/1.1\r\n{HEAD}Content-Length: 1000000\r\n\r\n".encode() + b"x" * 900_000
    return _held(target, [begin] * 200, 3)


def silent_connections(target: Target) -> str:
    """200 connections that say nothing, or the beginning of a request."""
    return _held(target, [b"", b"GET /healthz HT"] * 100, 2)


def many_headers(target: Target) -> str:
    """Headers of a few bytes, as many as fit, and more."""
    statuses = set()
    end = time.monotonic() + 5
    while time.monotonic() < end:
        for count in (2500, 50_000):
            with contextlib.suppress(OSError):
                head = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
                statuses.add(target.ask(head + b"a:b\r\n" * count + b"\r\n").status)
    assert statuses <= {0, 200, 431}, statuses
    return f"answered {sorted(statuses)}"


def pipelined_requests(target: Target) -> str:
    """Requests without a pause, 2,000 in one piece, on 40 connections."""
    request = b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n"
    sent, opened = _flood(target, request, request * 2000, 40, 10.0)
    return f"{sent / 2**20:.0f} MB on {opened} connections"


def large_static_file(target: Target) -> str:
    """500 requests for the largest file, of which nobody reads the answer."""
    held, request = [], b"GET /static/plotly.min.js HTTP/1.1\r\nHost: localhost\r\n\r\n"
    for number in range(500):
        with contextlib.suppress(OSError):
            connection = target.connect(5)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            gzip = b"Accept-Encoding: gzip\r\n\r\n" if number % 2 else b"\r\n"
            connection.sendall(request[:-2] + gzip)
            held.append(connection)
        if len(held) >= 240:
            held.pop(0).close()
    time.sleep(5)
    for connection in held:
        connection.close()
    begun = time.monotonic()
    answer = target.get("/static/plotly.min.js", Accept_Encoding="gzip")
    assert answer.status in (200, 503), answer.head
    return f"afterwards {answer.status} in {time.monotonic() - begun:.2f} s"


def many_mistakes(target: Target) -> str:
    """500,000 wrong levels in one body, and other bodies that are nothing but mistakes."""
    bodies: Iterable[bytes] = (
        json.dumps({"horizon": "1h", "levels": [2] * 330_000}).encode(),
        json.dumps({"horizon": "1h", "levels": [2] * 15_000}).encode(),
        json.dumps({"horizon": "1h"} | {f"f{i}": 1 for i in range(9_000)}).encode(),
        json.dumps({"horizon": "1h", "inputs": {f"f{i}": 1 for i in range(9_000)}}).encode(),
        b"[" * 1_000_000,
        b'{"horizon":"\\ud800"}',
        b'{"' + b"x" * 1_000_000 + b'":1}',
    )
    largest = 0
    for body in bodies:
        answer = target.post("/zones/zone-one/forecast", body)
        assert 400 <= answer.status < 500, (answer.status, body[:40])
        largest = max(largest, len(answer.body))
    assert largest < 50_000, largest
    return f"the largest answer has {largest} bytes"


def abandoned_fans(target: Target) -> str:
    """40 forecasts over 2,016 steps whose client has gone, and then one of another client."""
    request = b"GET /zones/zone-one/forecast?horizon=2016s HTTP/1.1\r\nHost: localhost\r\n\r\n"
    for _ in range(40):
        connection = target.connect(5)
        connection.sendall(request)
        time.sleep(0.02)
        connection.close()
    begun = time.monotonic()
    answer = target.get("/zones/zone-one/forecast?horizon=10s")
    seconds = time.monotonic() - begun
    assert answer.status == 200, answer
    assert seconds < 10.0, seconds
    return f"another client waited {seconds:.2f} s"


def fill_history(folder: Path) -> None:
    """Give the zone of a daemon that is to come in `folder` a history of ROWS rows."""

    async def fill() -> None:
        store = Store(folder / "state")
        for step in range(ROWS):
            store.record("zone-one", make_update(step))
        await store.run(store.journal.flush)
        store.close()

    asyncio.run(fill())


def much_history(target: Target) -> str:
    """All of a long history, again and again, on eight connections."""
    assert len(json.loads(target.get(f"/zones/zone-one/history?limit={ROWS}").body)["rows"]) == ROWS
    return hammered(target, [target.request(f"/zones/zone-one/history?limit={ROWS}")], 10.0, {200, 429, 503})


def large_plans(target: Target) -> str:
    """Forecasts of a zone under plans, as many steps and scenarios as one request may ask for."""
    plans = [{"name": f"plan {k}"} for k in range(10)]
    body = {"horizon": "2016s", "zones": ["zone-one"], "levels": [0.5, 0.95], "scenarios": 17, "plans": plans}
    return hammered(target, [target.request("/forecasts", json.dumps(body).encode())], 10.0, {200, 429, 503})


def models_and_charts(target: Target) -> str:
    """Models with all their draws, charts with all their points, and the overview."""
    paths = ("/zones/zone-one/model?draws=1000", "/zones/zone-one/series?points=2000", "/overview")
    return hammered(target, list(map(target.request, paths)), 10.0, {200, 429, 503})


BEFORE = {much_history: fill_history}
"""What an attack needs to find; called with the folder of the daemon before it starts."""

ATTACKS = {
    "1 one connection of tiny chunks": _endless("/zones/zone-one/forecast", TINY, 1),
    "1 sixty connections of tiny chunks": _endless("/zones/zone-one/forecast", TINY, 60),
    "1 bodies on paths that take none": _endless("/healthz", b"4000\r\n" + b"x" * 0x4000 + b"\r\n", 60),
    "1 bodies that do not end": unfinished_bodies,
    "1 headers of a few bytes": many_headers,
    "1 pipelined requests": pipelined_requests,
    "2 the largest file, unread": large_static_file,
    "3 bodies of mistakes": many_mistakes,
    "5 abandoned forecasts": abandoned_fans,
    "17 a long history": much_history,
    "large plans": large_plans,
    "models and charts": models_and_charts,
    "silent connections": silent_connections,
}
