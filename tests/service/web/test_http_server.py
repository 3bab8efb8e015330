"""The HTTP server inside the event loop."""

import socket
import stat

import httpx
import pytest
from fastapi import FastAPI, Request
from support.served import Client, config, serving

from service.config.http import HttpConfig
from service.errors import ServiceError
from service.publish.metrics import Metrics
from service.web.app import create_app
from service.web.measures import http_measures
from service.web.server.listener import SEND_BUFFER
from service.web.server.peers import peer_of
from service.web.server.server import HttpServer


async def test_connections_send_at_once_and_the_system_holds_little_of_it():
    async with serving(FastAPI(), config()) as server:
        client = await Client.to(server)
        assert (await client.ask("/nothing")).status == 404
        (connection,) = server.open_connections
        accepted = connection.transport.get_extra_info("socket")
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0
        assert accepted.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) <= 2 * SEND_BUFFER


async def test_connections_and_answers_are_figures():
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


def on_file(path, **settings):
    # A free port is not asked for where there is none.
    return HttpConfig.model_validate({"socket": path} | settings, context={"folder": "/"})


async def test_a_unix_socket_is_for_the_account_and_its_group(tmp_path):
    path = tmp_path / "http.sock"

    async def ask(**headers):
        transport = httpx.AsyncHTTPTransport(uds=str(path))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost", headers=headers) as client:
            return (await client.get("/peer")).json()

    app = FastAPI()

    @app.get("/peer")
    async def peer(request: Request):
        return peer_of(request.scope)

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as killed:
        killed.bind(str(path))
    async with serving(app, on_file(path)) as server:
        assert server.url == f"unix:{path}"
        assert stat.S_IMODE(path.stat().st_mode) == 0o660
        assert await ask(**{"X-Forwarded-For": "203.0.113.9"}) == "unix", "not said to be a proxy"
        with pytest.raises(ServiceError, match=r"http\.sock cannot be used"):
            HttpServer(app, on_file(path))
    assert not path.exists()
    async with serving(app, on_file(path, behind_tls_proxy=True)):
        assert await ask(**{"X-Forwarded-For": "198.51.100.1, unix, 203.0.113.9"}) == "203.0.113.9", "the last hop"
    path.write_text("precious")
    with pytest.raises(ServiceError, match="cannot be used"):
        HttpServer(app, on_file(path))
    assert path.read_text() == "precious", "what is no socket is left alone"
