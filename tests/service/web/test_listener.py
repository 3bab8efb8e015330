"""The socket that REST is served on."""

import socket

from fastapi import FastAPI
from support.served import Client, config, serving

from service.web.server.listener import SEND_BUFFER, listener


def test_the_system_takes_little_for_a_client_that_does_not_read():
    with listener(config(), "http.port") as server, socket.socket() as deaf:
        server.listen()
        server.setblocking(True)
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.connect(server.getsockname())
        accepted, _ = server.accept()
        with accepted:
            accepted.setblocking(False)
            taken = 0
            try:
                while taken < 64 * SEND_BUFFER:
                    taken += accepted.send(bytes(SEND_BUFFER))
            except BlockingIOError:
                pass
    # Linux doubles what it is told, for its own keeping of books; the client's side takes some kB.
    assert 0 < taken <= 3 * SEND_BUFFER


async def test_the_connections_of_the_server_have_that_bound():
    async with serving(FastAPI(), config()) as server:
        client = await Client.to(server)
        assert (await client.ask("/")).status == 404
        (accepted,) = [connection.transport.get_extra_info("socket") for connection in server.open_connections]
        assert accepted.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) <= 2 * SEND_BUFFER
        await client.close()
