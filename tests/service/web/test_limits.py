"""How many streams there may be."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path

import httpx
import pytest
from fastapi import Depends, FastAPI
from fastapi.responses import StreamingResponse
from support.waiting import until

from service.config.http import LimitsConfig
from service.publish.metrics import Metrics
from service.records.asker import Asker, asked_by
from service.web import limits
from service.web.app import create_app
from service.web.keys import KeyRing, create_key, revoke_key
from service.web.limits import STREAMS, Limiter, stream_slot
from service.web.server.refusal import RequestRefused


def limited(**limits: int) -> Limiter:
    return Limiter(LimitsConfig.model_validate(limits, context={"folder": "/"}))


async def test_a_client_has_its_share_and_all_together_the_total() -> None:
    limiter = limited(streams_per_client=2, streams=3)

    async def open_for(stack: AsyncExitStack, client: str) -> None:
        asked_by(Asker(client))
        await stack.enter_async_context(limiter.turn(STREAMS))

    async with AsyncExitStack() as stack:
        for client in ("a", "a", "b"):
            await open_for(stack, client)
        for client, status in (("a", 429), ("c", 503)):
            with pytest.raises(RequestRefused) as refused:
                await open_for(stack, client)
            assert refused.value.status == status
        assert limiter.open(STREAMS) == 3
    assert limiter.open(STREAMS) == 0
    assert not limiter._queues[STREAMS]._turns, "clients that have gone leave nothing behind"


async def test_nobody_waits_for_ever_behind_their_own_requests(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(limits, "LONG_WAIT_SECONDS", 0.01)
    short = {limits.LARGE: limits.Limit("large answers", 2, 1, 3, 0.1, 5)}
    monkeypatch.setattr(limits, "table", lambda config: short)
    limiter = Limiter()
    asked_by(Asker("greedy"))
    async with limiter.turn(limits.LARGE):
        with pytest.raises(RequestRefused, match=r"have waited 0\.1 s") as late:
            async with limiter.turn(limits.LARGE):
                pass
        assert late.value.status == 429
        asked_by(Asker("other"))
        async with limiter.turn(limits.LARGE):
            assert limiter.open(limits.LARGE) == 2
    assert "greedy has waited 0 s for its turn; large answers: greedy 2" in caplog.text


@pytest.fixture
def app(tmp_path: Path) -> FastAPI:
    app = create_app("htwg", {}, Metrics({}).registry, keys=KeyRing(tmp_path / "keys.json", required=False))
    app.state.limiter = limited(streams_per_client=1, streams=2)
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


async def test_a_place_is_held_until_the_stream_has_ended(app: FastAPI, tmp_path: Path) -> None:
    secrets = [create_key(tmp_path / "keys.json", name, "read") for name in ("one", "two", "three")]
    first, second, third = ({"authorization": f"Bearer {secret}"} for secret in secrets)
    running = asyncio.create_task(ask(app, "/stream", **first))
    await until(lambda: app.state.limiter.open(STREAMS) == 1)
    assert await ask(app, "/stream", **first) == 429, "clients are told apart by their keys, not their address"
    other = asyncio.create_task(ask(app, "/stream", **second))
    await until(lambda: app.state.limiter.open(STREAMS) == 2)
    assert await ask(app, "/stream", **third) == 503
    app.state.go.set()
    assert (await running, await other) == (200, 200)
    assert app.state.limiter.open(STREAMS) == 0


async def test_a_stream_ends_when_its_key_is_revoked(app: FastAPI, tmp_path: Path) -> None:
    async def ticks() -> AsyncIterator[bytes]:
        while True:
            yield b"tick"
            await asyncio.sleep(0.01)

    @app.get("/ticks", dependencies=[Depends(stream_slot)])
    async def tick() -> StreamingResponse:
        return StreamingResponse(ticks())

    secret = create_key(tmp_path / "keys.json", "one", "read")

    running = asyncio.create_task(ask(app, "/ticks", authorization=f"Bearer {secret}"))
    await until(lambda: app.state.limiter.open(STREAMS) == 1)
    await asyncio.sleep(0.1)
    assert not running.done()
    revoke_key(tmp_path / "keys.json", "one")
    assert await asyncio.wait_for(running, 180) == 200
    assert app.state.limiter.open(STREAMS) == 0


async def test_a_place_is_given_back_if_the_stream_breaks_or_its_client_goes(app: FastAPI) -> None:
    await ask(app, "/broken")
    assert app.state.limiter.open(STREAMS) == 0
    running = asyncio.create_task(ask(app, "/stream"))
    await until(lambda: app.state.limiter.open(STREAMS) == 1)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    await until(lambda: app.state.limiter.open(STREAMS) == 0)
