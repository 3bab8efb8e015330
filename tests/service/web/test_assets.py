"""What is the same for every client: read once, compressed once."""

from __future__ import annotations

import asyncio
import gzip

import httpx
import pytest
from fastapi import FastAPI
from starlette.responses import Response
from support.http_client import get

from service.publish.metrics import Metrics
from service.web import pages
from service.web.app import create_app

PLOTLY = "/static/plotly.min.js"


def daemon_app() -> FastAPI:
    return create_app("htwg", {}, Metrics({}).registry)


def test_the_largest_file_is_read_and_compressed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reads = []
    content = "// plotly".ljust(200_000, "x")
    monkeypatch.setattr(pages, "get_plotlyjs", lambda: reads.append(1) or content)
    compressed = []
    monkeypatch.setattr(gzip, "compress", lambda *a, _own=gzip.compress, **k: compressed.append(1) or _own(*a, **k))
    app = daemon_app()

    async def scenario() -> list[httpx.Response]:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            at_once = await asyncio.gather(*(client.get(PLOTLY) for _ in range(20)))
            plain = await client.get(PLOTLY, headers={"Accept-Encoding": "identity"})
            return [*at_once, plain]

    *answers, plain = asyncio.run(scenario())
    assert {(answer.status_code, answer.text) for answer in [*answers, plain]} == {(200, content)}
    assert {answer.headers["content-encoding"] for answer in answers} == {"gzip"}
    assert "content-encoding" not in plain.headers
    assert (len(reads), len(compressed)) == (1, 1)


@pytest.mark.parametrize("path", ["/", "/docs", "/openapi.json", "/static/style.css", "/static/icon.svg", PLOTLY])
def test_who_has_it_is_not_sent_it_again(path: str) -> None:
    app = daemon_app()
    first = get(app, path)
    assert (first.status_code, first.headers["vary"]) == (200, "Accept-Encoding")
    again = get(app, path, headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("size", [10, 2_000, 300_000])
def test_answers_are_compressed_for_who_takes_that(size: int) -> None:
    app = daemon_app()
    app.add_route("/text", lambda request: Response(b"x" * size), include_in_schema=False)
    answer = get(app, "/text")
    assert answer.content == b"x" * size
    assert answer.headers.get("content-encoding") == ("gzip" if size > 1024 else None)
    assert int(answer.headers["content-length"]) <= size
    assert get(app, "/text", headers={"Accept-Encoding": "identity"}).headers["content-length"] == str(size)
