"""The real server against clients that are slow, greedy, deaf or do not speak HTTP."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator

import pytest
from fastapi import FastAPI, Request, Response
from fastapi.responses import StreamingResponse
from support.served import Client, ask, config, serving
from support.tables import tabled
from support.waiting import until

from service.publish.metrics import Metrics
from service.web.app import create_app
from service.web.server import server as http_server
from service.web.server.connection import FREE_CHUNKS, Passes
from service.web.server.peers import peer_of

QUICK = {"receive_timeout": 0.6, "send_timeout": 0.6, "idle_timeout": 0.6}


def small_app() -> FastAPI:
    app = FastAPI()
    app.state.ended = 0

    @app.get("/")
    async def root(request: Request) -> dict[str, str]:
        return {"peer": peer_of(request.scope), "scheme": request.url.scheme}

    @app.post("/size")
    async def size(request: Request) -> int:
        return len(await request.body())

    @app.get("/slow")
    async def slow() -> str:
        await asyncio.sleep(1.0)
        return "done"

    @app.get("/large")
    async def large(megabytes: int) -> Response:
        return Response(bytes(megabytes * 2**20))

    @app.get("/endless")
    async def endless() -> StreamingResponse:
        async def chunks() -> AsyncIterator[bytes]:
            try:
                while True:
                    yield bytes(2**16)
                    await asyncio.sleep(0)
            finally:
                app.state.ended += 1

        return StreamingResponse(chunks())

    return app


@tabled
async def test_a_request_that_does_not_come_to_its_end_is_given_up(begun: str) -> None:
    async with serving(small_app(), config(limits=QUICK)) as server:
        client, trickling = await Client.to(server), await Client.to(server)
        await client.send(begun.encode())
        await trickling.send(b"GET / HTTP/1.1\r\nX: ")

        async def trickle() -> None:
            while not client.reader.at_eof():
                await trickling.send(b"x")
                await asyncio.sleep(0.05)

        dripping = asyncio.create_task(trickle())
        answer = await client.answer()
        assert answer.status == 408
        assert "not complete within 0.6 s" in answer.problem()
        assert await client.ended() == b""
        # Bytes that come after the end may have the system reset the connection before the answer is read.
        late = await trickling.ended()
        assert not late or late.startswith(b"HTTP/1.1 408"), "a byte now and then keeps nothing alive"
        dripping.cancel()
        await asyncio.gather(dripping, return_exceptions=True)


async def test_a_connection_without_requests_is_closed() -> None:
    async with serving(small_app(), config(limits=QUICK)) as server:
        silent, idle = await Client.to(server), await Client.to(server)
        assert (await idle.ask("/slow")).body == b'"done"', "a slow answer is not the client's fault"
        assert (await idle.ask()).status == 200, "kept alive between two requests"
        for client in (silent, idle):
            assert await client.ended() == b""


@pytest.mark.parametrize("path", ["/large?megabytes=32", "/endless"])
async def test_who_never_reads_is_cut_off(path: str) -> None:
    app = small_app()
    async with serving(app, config(limits=QUICK)) as server:
        deaf = await Client.to(server, limit=1024)
        deaf.writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        await deaf.send(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        await until(lambda: server.cut_off["slow to read"])
        # Nothing is held for it any more, and the stream has ended too.
        await until(lambda: not server.open_connections)
        await until(lambda: app.state.ended == (path == "/endless"))
        assert (await ask(server)).status == 200


@pytest.mark.parametrize("path", ["/large?megabytes=8", "/endless"])
async def test_who_reads_slowly_gets_it_all(path: str) -> None:
    async with serving(small_app(), config(limits=QUICK | {"send_timeout": 1.0})) as server:
        client = await Client.to(server, limit=2**14)
        client.writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**16)
        await client.send(f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())
        # For several times as long as it may take to make progress, and more than the system's buffers hold.
        for _ in range(8 * 8):
            await client.reader.readexactly(2**17)
            await asyncio.sleep(0.04)


async def test_what_a_client_has_not_taken_when_the_server_stops_is_dropped() -> None:
    """The connection would otherwise stay open until the garbage collector finds it, in whatever runs then."""
    async with serving(small_app(), config()) as server:
        deaf = await Client.to(server, limit=1024)
        await deaf.send(b"GET /large?megabytes=32 HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        await until(lambda: any(one.unsent > 2**20 for one in server.open_connections))
    assert not server.open_connections
    assert server.connections == 0


async def test_room_for_answers_is_made_before_the_next_one_is_taken_in() -> None:
    """Between two sweeps a thousand answers could begin to wait."""
    async with serving(small_app(), config(limits={"unsent": 2**20, "send_timeout": 170})) as server:
        deaf = [await Client.to(server, limit=1024) for _ in range(8)]
        for client in deaf:
            await client.send(b"GET /large?megabytes=24 HTTP/1.1\r\nHost: localhost\r\n\r\n")
        await until(lambda: server.cut_off["slow to read"] == 7)
        assert len([one for one in server.open_connections if not one.transport.is_closing()]) == 1


async def test_too_many_connections_are_told_so_and_then_shut_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_server, "SPARE", 2)
    async with serving(small_app(), config(limits={"connections": 3})) as server:
        served = [await Client.to(server) for _ in range(3)]
        for client in served:
            assert (await client.ask()).status == 200
        refused = await Client.to(server)
        answer = await refused.ask()
        assert (answer.status, answer.headers["connection"]) == (503, "close")
        assert int(answer.headers["retry-after"]) > 0
        assert "too many connections" in answer.problem()
        await refused.close()
        spare = [await Client.to(server) for _ in range(2)]
        shut_out = await Client.to(server)
        assert await shut_out.ended() == b""
        for client in (*served, *spare, shut_out):
            await client.close()
        await until(lambda: server.connections == 0)
        assert (await ask(server)).status == 200, "places are given back"
        await until(lambda: server.connections == 0)


async def test_one_client_does_not_take_all_places_but_a_proxy_may_bring_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_server, "is_loopback", lambda host: False)
    forwarded = {"X-Forwarded-For": "203.0.113.9", "X-Forwarded-Proto": "https"}
    limits = {"connections": 100, "connections_per_client": 1}
    async with serving(small_app(), config(limits=limits)) as server:
        first = await Client.to(server)
        assert (await first.ask(**forwarded)).body == b'{"peer":"127.0.0.1","scheme":"http"}', "nobody is believed"
        assert (await ask(server)).status == 503
    async with serving(small_app(), config(limits=limits, behind_tls_proxy=True)) as server:
        first = await Client.to(server)
        assert (await first.ask()).status == 200
        assert (await ask(server, **forwarded)).body == b'{"peer":"203.0.113.9","scheme":"https"}'


async def test_a_socket_for_both_kinds_of_addresses_knows_proxies_of_either() -> None:
    if not socket.has_dualstack_ipv6():
        pytest.skip("this machine has no IPv6")
    async with serving(small_app(), config(host="::", behind_tls_proxy=True)) as server:
        assert b'"peer":"203.0.113.9"' in (await ask(server, **{"X-Forwarded-For": "203.0.113.9"})).body
        assert b'"peer":"127.0.0.1"' in (await ask(server)).body


LIMITS = {"body": 1024, "url": 256, "headers": 1024}


@pytest.fixture(scope="module")
def daemon_app() -> FastAPI:
    return create_app("htwg", {}, Metrics({}).registry, http=config(limits=LIMITS))


CHUNKED = b"POST /size HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"
HOST = b" HTTP/1.1\r\nHost: localhost\r\n"
REFUSED = {
    "body by its length": (b"POST /zones" + HOST + b"Content-Length: 999999\r\n\r\n", 413),
    "body in chunks": (CHUNKED.replace(b"/size", b"/zones/a/forecast") + 2 * (b"400\r\n" + b"x" * 1024 + b"\r\n"), 413),
    "a chunk that is too large": (CHUNKED + b"ffffffffffffffffffff1\r\n", 400),
    "a chunk of less than nothing": (CHUNKED + b"-1\r\n", 400),
    "a long line before a chunk": (CHUNKED + b"1" * 2000, 431),
    "length and chunks": (CHUNKED.replace(b"Transfer", b"Content-Length: 4\r\nTransfer") + b"0\r\n\r\n", 400),
    "another coding than chunks": (CHUNKED.replace(b"chunked", b"gzip"), 501),
    "chunks in HTTP/1.0": (CHUNKED.replace(b"1.1", b"1.0") + b"0\r\n\r\n", 400),
    "many headers in one piece": (b"GET /" + HOST + b"a: b\r\n" * 1000 + b"\r\n", 431),
    "long path": (b"GET /" + b"x" * 300 + HOST + b"\r\n", 414),
    "long query": (b"GET /zones?" + b"x" * 300 + HOST + b"\r\n", 414),
    "long headers": (b"GET /" + HOST + b"X: " + b"x" * 1100 + b"\r\n\r\n", 431),
    "headers without end": (b"GET /" + HOST + b"X: " + b"x" * 1100, 431),
    "no HTTP": (b"\x16\x03\x01\x00\xa5\x01\x00\x00\xa1\r\n\r\n", 400),
    "no host": (b"GET / HTTP/1.1\r\n\r\n", 400),
    "two lengths": (b"POST /zones" + HOST + b"Content-Length: 1\r\nContent-Length: 2\r\n\r\n12", 400),
    "another host": (b"GET / HTTP/1.1\r\nHost: attacker.example\r\n\r\n", 421),
}


@pytest.mark.parametrize("case", REFUSED)
async def test_what_is_too_large_or_wrong_is_refused_with_a_problem(
    daemon_app: FastAPI, case: str, caplog: pytest.LogCaptureFixture
) -> None:
    request, status = REFUSED[case]
    async with serving(daemon_app, config(limits=LIMITS)) as server:
        client = await Client.to(server)
        await client.send(request)
        answer = await client.answer()
        assert answer.status == status
        assert answer.problem()
        if status != 421:
            assert await client.ended() == b"", "what else may come is not read"
        await client.close()
        assert (await ask(server, "/healthz")).status == 200
    assert not [record for record in caplog.records if record.name != "audit"], "its sender's business"


async def test_bodies_up_to_the_limit_are_taken(daemon_app: FastAPI) -> None:
    async with serving(daemon_app, config(limits=LIMITS)) as server:
        for body in (b"Content-Length: 1024\r\n\r\n" + b"x" * 1024, b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n"):
            client = await Client.to(server)
            await client.send(b"POST /zones" + HOST + body)
            assert (await client.answer()).status == 405, "taken in, and for the application to judge"


@pytest.mark.parametrize("path", ["/size", "/"])
async def test_a_body_in_endless_tiny_chunks_ends_its_connection(path: str) -> None:
    async with serving(small_app(), config(limits={"receive_timeout": 170, "idle_timeout": 170})) as server:
        client = await Client.to(server)
        await client.send(CHUNKED.replace(b"/size", path.encode()) + b"1\r\na\r\n" * (FREE_CHUNKS + 10))
        answer = await client.ended()
        assert answer.startswith(b"HTTP/1.1 400"), "whether a route reads the body or not"
        assert b"send it in larger ones" in answer
        fair, count = await Client.to(server), 3 * FREE_CHUNKS
        await fair.send(CHUNKED + (b"200\r\n" + b"x" * 512 + b"\r\n") * count + b"0\r\n\r\n")
        assert (await fair.answer()).body == str(512 * count).encode(), "those of a fair size are taken, however many"


async def test_one_pass_of_the_loop_is_no_longer_than_it_may_be() -> None:
    passes, done = Passes(), list[str]()

    def work(name: str) -> None:
        done.append(name)
        time.sleep(0.003)

    for name in ("a", "b"):
        passes.add(lambda name=name: work(name))
    asyncio.get_running_loop().call_soon(lambda: done.append("something else"))
    await until(lambda: len(done) == 3)
    assert done == ["a", "something else", "b"]
