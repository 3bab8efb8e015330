"""The stream parser and the error path: any bytes on a connection, in any pieces, are answered as HTTP, never with a
5xx, and the next connection is served.

Chunks, pipelined requests, and requests that are refused for their size all go through the real protocol class on a
transport in memory.
"""

import asyncio
import json
import re
from functools import cache
from typing import Any

import h11
from fastapi import FastAPI
from fuzz.fuzzing import raw, structured
from hypothesis import strategies as st
from support.fake_zones import running
from uvicorn.config import Config
from uvicorn.server import ServerState

from service.config.http import LimitsConfig
from service.publish.metrics import Metrics
from service.web.app import create_app
from service.web.server.connection import CHUNK_BYTES, FREE_CHUNKS, READ_BYTES, Connection, Parser, Passes

GET = b"GET /zones HTTP/1.1\r\nHost: localhost\r\n\r\n"
PLAN = b'{"horizon":"1h","levels":[0.5,0.95],"inputs":{"u_heat":1500}}'
POST = b"POST /zones/living/forecast HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
WHOLE = POST + b"Content-Length: %d\r\n\r\n" % len(PLAN) + PLAN
CHUNKED = POST + b"Transfer-Encoding: chunked\r\n\r\n" + b"%x;a=b\r\n%s\r\n" % (len(PLAN), PLAN) + b"0\r\nX: y\r\n\r\n"
WRONG = POST + b'Content-Length: 20\r\n\r\n{"horizon":"\\ud800"}'
SEEDS = (GET, WHOLE, CHUNKED, WRONG, GET * 3, CHUNKED + GET, WHOLE + CHUNKED, POST + b"Expect: 100-continue\r\n\r\n")


class Transport(asyncio.Transport):
    """A connection in memory that takes everything at once."""

    def __init__(self) -> None:
        super().__init__({"peername": ("127.0.0.1", 5), "sockname": ("127.0.0.1", 8080)})
        self.written = bytearray()
        self.closing = False

    def write(self, data: Any) -> None:
        if not self.closing:
            self.written += data

    def close(self) -> None:
        self.closing = True

    abort = close

    def is_closing(self) -> bool:
        return self.closing

    def get_write_buffer_size(self) -> int:
        return 0

    def pause_reading(self) -> None:
        pass

    def resume_reading(self) -> None:
        pass


@cache
def served() -> tuple[FastAPI, LimitsConfig, asyncio.AbstractEventLoop]:
    zones = {"living": running("living")}
    app = create_app("htwg", zones, Metrics(zones).registry)
    return app, LimitsConfig(body=4096, headers=2048), asyncio.new_event_loop()


def answered(pieces: list[bytes]) -> bytes:
    """What the server writes to a connection on which `pieces` come."""
    app, limits, loop = served()

    async def scenario() -> bytes:
        config = Config(app, http="h11", ws="none", log_config=None, lifespan="off")
        config.load()
        transport, state = Transport(), ServerState()
        protocol = Connection((config, state), limits, Passes(), lambda: None, lambda: None)
        protocol.connection_made(transport)
        for piece in pieces:
            for begin in range(0, len(piece), READ_BYTES):
                if not transport.closing:
                    part = piece[begin : begin + READ_BYTES]
                    protocol.get_buffer(-1)[: len(part)] = part
                    protocol.buffer_updated(len(part))
                    await asyncio.sleep(0)
        # Until everything that can be answered is: tasks end, or wait for more of the request.
        for _ in range(40):
            await asyncio.sleep(0)
        tasks = set(state.tasks)
        protocol.check(loop.time() + limits.receive_timeout + 1)
        transport.closing = True
        protocol.connection_lost(None)
        if tasks:
            await asyncio.wait(tasks, timeout=20)
            assert all(task.done() for task in tasks), "a request goes on after its client has gone"
        return bytes(transport.written)

    return loop.run_until_complete(scenario())


def judge(written: bytes) -> None:
    """Everything is HTTP, and nothing says that the server is at fault; 501 is for a coding that nobody knows."""
    for status in re.findall(rb"HTTP/1\.1 (\d{3}) ", written):
        assert not status.startswith(b"5") or status in (b"501", b"503"), written[:500]
    assert not written or written.startswith(b"HTTP/1.1 "), written[:100]
    assert b"Traceback" not in written


@raw(*SEEDS, examples=60)
def test_stream(data: bytes) -> None:
    judge(answered([data]))


@structured(
    examples=40,
    parts=st.lists(st.sampled_from([*SEEDS, b"\r\n", b"0\r\n\r\n", b"1\r\na\r\n", b"x" * 3000]), max_size=6),
    cuts=st.lists(st.integers(0, 4000), max_size=8),
)
def test_stream_in_pieces(parts: list[bytes], cuts: list[int]) -> None:
    content, pieces, begin = b"".join(parts), [], 0
    for cut in sorted(cuts):
        pieces.append(content[begin:cut])
        begin = max(begin, cut)
    judge(answered([piece for piece in (*pieces, content[begin:]) if piece]))


@structured(examples=100, sizes=st.lists(st.integers(1, 2000), min_size=1, max_size=3000))
def test_chunks(sizes: list[int]) -> None:
    """A body is given whole, or refused for its chunks."""
    parser = Parser(2048)
    chunks = b"".join(b"%x\r\n%s\r\n" % (size, b"x" * size) for size in sizes)
    parser.receive_data(POST + b"Transfer-Encoding: chunked\r\n\r\n" + chunks + b"0\r\n\r\n")
    received = 0
    try:
        while not isinstance(event := parser.next_event(), h11.EndOfMessage):
            received += len(event.data) if isinstance(event, h11.Data) else 0
    except h11.RemoteProtocolError as error:
        assert len(sizes) > FREE_CHUNKS
        assert "larger ones" in str(error)
        return
    assert received == sum(sizes)
    assert len(sizes) <= FREE_CHUNKS + sum(sizes) // CHUNK_BYTES


@structured(examples=60, body=st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=30) | st.dictionaries(st.text(max_size=10), inner, max_size=30),
    max_leaves=60,
))  # fmt: skip
def test_error_path(body: Any) -> None:
    """Any JSON where a plan is wanted: an answer of few sentences."""

    content = json.dumps(body).encode()[:4096]
    written = answered([POST + b"Content-Length: %d\r\n\r\n" % len(content) + content])
    judge(written)
    assert len(written) < 30_000
