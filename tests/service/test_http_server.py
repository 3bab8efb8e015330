"""The HTTP server inside the event loop."""

import asyncio
import socket

from fastapi import FastAPI

from service.config_models import HttpConfig
from service.http_server import HttpServer


def test_answers_do_not_wait_for_more_to_send():
    async def scenario():
        server = HttpServer(FastAPI(), HttpConfig(port=0))
        serving = asyncio.create_task(server.run())
        await server.started(serving)
        reader, writer = await asyncio.open_connection("127.0.0.1", int(server.url.rpartition(":")[2]))
        writer.write(b"GET /nothing HTTP/1.1\r\nHost: thermogate\r\n\r\n")
        assert b"404" in await reader.readline()
        (connection,) = server._server.server_state.connections
        accepted = connection.transport.get_extra_info("socket")
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0
        writer.close()
        await writer.wait_closed()
        await server.stop(serving)

    asyncio.run(scenario())
