"""How many streams there may be."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
from fastapi import Depends, FastAPI
from fastapi.responses import StreamingResponse
from support.waiting import until

from service.publish.metrics import Metrics
from service.web.app import create_app
from service.web.keys import KeyRing, create_key, revoke_key
from service.web.limits import StreamLimits, stream_slot
from service.web.server.refusal import RequestRefused


def test_a_client_has_its_share_and_all_together_the_total() -> None:
    limits = StreamLimits(per_client=2, total=3)
    with limits.admitted("a"), limits.admitted("a"):
        with pytest.raises(RequestRefused) as much, limits.admitted("a"):
            pass
        with limits.admitted("b"):
            with pytest.raises(RequestRefused) as full, limits.admitted("c"):
                pass
            assert limits.open == 3
    assert (much.value.status, full.value.status) == (429, 503)
    assert limits.open == 0
    assert not limits._open, "clients that have gone leave nothing behind"


@pytest.fixture
def app(tmp_path: Path) -> FastAPI:
    app = create_app("htwg", {}, Metrics({}).registry, keys=KeyRing(tmp_path / "keys.json", required=False))
    app.state.stream_limits = StreamLimits(per_client=1, total=2)
    app.state.go = asyncio.Event()

    async def numbers() -> AsyncIterator[bytes]:
        yield b"1"
        await app.state.go.wait()
        yield b"2"

    async def broken() -> AsyncIterator[bytes]:
        yield b"1"
        raise OSError("gone")

    @app.get("/stream", dependencies=[Depends(stream_slot)])
    async def stream() -> StreamingResponse:
        return StreamingResponse(numbers())

    @app.get("/broken", dependencies=[Depends(stream_slot)])
    async def break_off() -> StreamingResponse:
        return StreamingResponse(broken())

    return app


async def ask(app: FastAPI, path: str, **headers: str) -> int:
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost", headers=headers) as client:
        return (await client.get(path)).status_code


def test_a_place_is_held_until_the_stream_has_ended(app: FastAPI, tmp_path: Path) -> None:
    secrets = [create_key(tmp_path / "keys.json", name, "read") for name in ("one", "two", "three")]
    first, second, third = ({"authorization": f"Bearer {secret}"} for secret in secrets)

    async def scenario() -> None:
        running = asyncio.create_task(ask(app, "/stream", **first))
        await until(lambda: app.state.stream_limits.open == 1)
        assert await ask(app, "/stream", **first) == 429, "clients are told apart by their keys, not their address"
        other = asyncio.create_task(ask(app, "/stream", **second))
        await until(lambda: app.state.stream_limits.open == 2)
        assert await ask(app, "/stream", **third) == 503
        app.state.go.set()
        assert (await running, await other) == (200, 200)
        assert app.state.stream_limits.open == 0

    asyncio.run(scenario())


def test_a_stream_ends_when_its_key_is_revoked(app: FastAPI, tmp_path: Path) -> None:
    async def ticks() -> AsyncIterator[bytes]:
        while True:
            yield b"tick"
            await asyncio.sleep(0.01)

    @app.get("/ticks", dependencies=[Depends(stream_slot)])
    async def tick() -> StreamingResponse:
        return StreamingResponse(ticks())

    secret = create_key(tmp_path / "keys.json", "one", "read")

    async def scenario() -> None:
        running = asyncio.create_task(ask(app, "/ticks", authorization=f"Bearer {secret}"))
        await until(lambda: app.state.stream_limits.open == 1)
        await asyncio.sleep(0.1)
        assert not running.done()
        revoke_key(tmp_path / "keys.json", "one")
        assert await asyncio.wait_for(running, 60) == 200
        assert app.state.stream_limits.open == 0

    asyncio.run(scenario())


def test_a_place_is_given_back_if_the_stream_breaks_or_its_client_goes(app: FastAPI) -> None:
    async def scenario() -> None:
        await ask(app, "/broken")
        assert app.state.stream_limits.open == 0
        running = asyncio.create_task(ask(app, "/stream"))
        await until(lambda: app.state.stream_limits.open == 1)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        await until(lambda: app.state.stream_limits.open == 0)

    asyncio.run(scenario())
