"""The real server with TLS: who gets through, and what becomes of those who do not finish their handshake."""

import asyncio
import gc
import socket
import ssl
import struct
from asyncio.sslproto import SSLProtocol
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI, Response
from starlette.types import Receive, Scope, Send
from support.certificates import Pair, make_pair
from support.served import Client, ask, config, serving
from support.waiting import PATIENCE, until

from service.config.http import HttpConfig
from service.errors import CertificateError
from service.publish.metrics import Metrics
from service.web.app import create_app
from service.web.measures import http_measures
from service.web.server.connection import PIECE, READ_BYTES, Connection

PLAIN = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"


@pytest.fixture
def pair(tmp_path: Path) -> Pair:
    return make_pair(tmp_path)


def app(size: int = 1) -> FastAPI:
    application = FastAPI()
    application.add_route("/", lambda request: Response(bytes(size)))
    return application


def encrypted(pair: Pair, **settings: Any) -> HttpConfig:
    return config(certificate=pair.certificate, private_key=pair.private_key, **settings)


def trusting(pair: Pair) -> ssl.SSLContext:
    return ssl.create_default_context(cafile=pair.certificate)


def serial(client: Client) -> int:
    return int(client.writer.get_extra_info("peercert")["serialNumber"], 16)


async def test_the_certificate_is_served_and_a_renewed_one_without_a_restart(tmp_path: Path) -> None:
    old = make_pair(tmp_path, kind="rsa")
    async with serving(app(), encrypted(old)) as server:
        assert server.url.startswith("https://")
        kept = await Client.to(server, trusting(old))
        assert serial(kept) == old.issued.serial_number
        new = make_pair(tmp_path)
        server.reload()
        assert serial(await Client.to(server, trusting(new))) == new.issued.serial_number
        assert (await kept.ask()).status == 200, "open connections go on"
        knowing = trusting(new)
        new.certificate.write_text("")
        with pytest.raises(CertificateError):
            server.reload()
        assert (await ask(server, context=knowing)).status == 200
        measures = http_measures(server, create_app("site", {}, Metrics({}).registry))
        (expiry,) = [measure.read() for measure in measures if "expiry" in measure.name]
        assert expiry == (((), new.issued.not_valid_after_utc.timestamp()),)


async def test_client_certificates(tmp_path: Path) -> None:
    authority = make_pair(tmp_path, "authority")
    friend, stranger = make_pair(tmp_path, "friend", signer=authority), make_pair(tmp_path, "stranger")
    settings = encrypted(make_pair(tmp_path, "server", signer=authority), client_ca=authority.certificate)
    known, unknown, without = trusting(authority), trusting(authority), trusting(authority)
    known.load_cert_chain(friend.certificate, friend.private_key)
    unknown.load_cert_chain(stranger.certificate, stranger.private_key)
    async with serving(app(), settings) as server:
        assert (await ask(server, context=known)).status == 200
        for context in (unknown, without):
            with pytest.raises((ssl.SSLError, ConnectionError, asyncio.IncompleteReadError)):
                await ask(server, context=context)


@pytest.mark.parametrize("greeting", [b"\x16", PLAIN])
async def test_who_does_not_finish_the_handshake_is_let_go(
    pair: Pair, greeting: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async with serving(app(), encrypted(pair, limits={"receive_timeout": 1.0, "connections": 2})) as server:
        client = await Client.to(server)
        await client.send(greeting)
        if greeting != PLAIN:
            # Counted before it is encrypted.
            await until(lambda: server.connections == 1)
        await client.ended()
        await until(lambda: server.connections == 0)
        await client.close()
        assert (await ask(server, context=trusting(pair))).status == 200
    assert not [record for record in caplog.records if record.levelname != "INFO"], "no noise in the log"


async def test_who_never_reads_is_cut_off_through_encryption_too(pair: Pair) -> None:
    async with serving(app(32 * 2**20), encrypted(pair, limits={"send_timeout": 0.3})) as server:
        deaf = await Client.to(server, trusting(pair), limit=1024)
        deaf.writer.transport.pause_reading()
        await deaf.send(PLAIN)
        await until(lambda: server.cut_off["slow to read"] and server.connections == 0)
        deaf.writer.transport.abort()


async def test_who_neither_goes_on_nor_closes_is_let_go_and_others_are_served(pair: Pair) -> None:
    async with serving(app(), encrypted(pair, limits={"receive_timeout": 0.3, "send_timeout": 2.0})) as server:
        silent = await Client.to(server, trusting(pair))
        await silent.send(PLAIN[:20])
        # It never takes the end of the encryption, so that the connection is closing for as long as sending may take.
        silent.writer.transport.pause_reading()
        await until(lambda: server.cut_off["slow to ask"])
        await until(lambda: server.connections == 0)
        assert (await ask(server, context=trusting(pair))).status == 200
        silent.writer.transport.abort()


async def test_an_encrypted_connection_holds_little(pair: Pair) -> None:
    async with serving(app(), encrypted(pair)) as server:
        client = await Client.to(server, trusting(pair))
        assert (await client.ask()).status == 200
        (connection,) = server.open_connections
        transport: Any = connection.transport
        assert transport.get_read_buffer_limits()[1] <= READ_BYTES
        assert transport.get_write_buffer_limits()[1] <= PIECE
        assert SSLProtocol.max_size <= READ_BYTES


def abandoned(client: Client) -> None:
    """Have the system reset the connection."""
    client.writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.writer.transport.abort()


@pytest.mark.parametrize("tls", [False, True])
async def test_ended_connections_leave_nothing_to_the_garbage_collector(pair: Pair, tls: bool) -> None:
    context = trusting(pair) if tls else None
    gc.collect()
    gc.disable()
    try:
        async with serving(app(), encrypted(pair) if tls else config()) as server:
            assert (await ask(server, context=context)).status == 200
            for begun in (PLAIN, PLAIN[:20]):
                client = await Client.to(server, context)
                await client.send(begun)
                await until(lambda: server.open_connections)
                abandoned(client)
                await until(lambda: server.connections == 0)
            # Neither HTTP nor a handshake.
            for refused in (await Client.to(server, context), await Client.to(server)):
                await refused.send(b"nonsense\r\n\r\n")
                await refused.ended()
            await until(lambda: server.connections == 0)
            await until(lambda: not [one for one in gc.get_objects() if type(one) is Connection])
    finally:
        gc.enable()


async def test_a_large_answer_to_a_client_that_has_gone_is_no_fault(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pair, gone, ended = make_pair(tmp_path), asyncio.Event(), asyncio.Event()

    class Late(Response):
        async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
            await gone.wait()
            try:
                await super().__call__(scope, receive, send)
            finally:
                ended.set()

    application = FastAPI()
    application.add_route("/", lambda request: Late(bytes(2 * PIECE)))
    async with serving(application, encrypted(pair)) as server:
        client = await Client.to(server, trusting(pair))
        await client.send(PLAIN)
        await until(lambda: server.open_connections)
        await client.close()
        await until(lambda: server.connections == 0)
        gone.set()
        await asyncio.wait_for(ended.wait(), PATIENCE)
    assert not [record for record in caplog.records if record.levelname != "INFO"], "no noise in the log"
