"""The HTTP server inside the event loop."""

import asyncio
import socket

from fastapi import FastAPI
from served import Client, config, serving

from service.api import create_app
from service.http_measures import http_measures
from service.http_models import HttpConfig
from service.http_server import HttpServer
from service.metrics import Metrics


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


def test_connections_and_answers_are_figures():
    async def scenario():
        metrics = Metrics({})
        app = create_app("site", {}, metrics.registry)
        async with serving(app, config(limits={"receive_timeout": 0.2})) as server:
            metrics.register(http_measures(server, app))
            slow = await Client.to(server)
            await slow.send(b"GET")
            assert (await slow.answer()).status == 408
            client = await Client.to(server)
            await client.ask("/nowhere")
            exposed = (await client.ask("/metrics")).body.decode()
            assert "thermogate_http_connections 1.0" in exposed
            assert "thermogate_http_streams 0.0" in exposed
            assert 'thermogate_http_answers_total{status="404"} 1.0' in exposed
            assert 'thermogate_http_cut_off_total{reason="slow to ask"} 1.0' in exposed
            assert "\nthermogate_certificate_expiry_timestamp_seconds" not in exposed, "no value without TLS"
            for one in (slow, client):
                await one.close()

    asyncio.run(scenario())
