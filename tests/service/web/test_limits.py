"""How many streams there may be."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
from fastapi import Depends
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


async def test_a_place_is_held_until_the_stream_ends_breaks_or_its_client_or_key_goes(tmp_path: Path) -> None:
    file = tmp_path / "keys.json"
    app = create_app("htwg", {}, Metrics({}).registry, keys=KeyRing(file, required=False))
    limiter = app.state.limiter = limited(streams_per_client=1, streams=2)
    go = asyncio.Event()

    async def events(breaks: bool) -> AsyncIterator[bytes]:
        while not go.is_set():
            yield b"tick"
            if breaks:
                raise OSError("gone")
            await asyncio.sleep(0.001)

    @app.get("/events", dependencies=[Depends(stream_slot)])
    async def stream(breaks: bool = False) -> StreamingResponse:
        return StreamingResponse(events(breaks))

    secrets = {name: create_key(file, name, "read") for name in ("one", "two", "three")}

    async def opened(name: str, query: str = "") -> int:
        headers = {"authorization": f"Bearer {secrets[name]}"}
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client:
            return (await client.get(f"/events{query}", headers=headers)).status_code

    with pytest.raises(OSError, match="gone"):
        await opened("one", "?breaks=true")
    first = asyncio.create_task(opened("one"))
    await until(lambda: limiter.open(STREAMS) == 1)
    assert await opened("one") == 429, "clients are told apart by their keys, not their address"
    second = asyncio.create_task(opened("two"))
    await until(lambda: limiter.open(STREAMS) == 2)
    assert await opened("three") == 503
    revoke_key(file, "one")
    assert await first == 200
    assert limiter.open(STREAMS) == 1
    second.cancel()
    await asyncio.gather(second, return_exceptions=True)
    assert limiter.open(STREAMS) == 0
    third = asyncio.create_task(opened("three"))
    await until(lambda: limiter.open(STREAMS) == 1)
    go.set()
    assert await third == 200
    assert limiter.open(STREAMS) == 0
