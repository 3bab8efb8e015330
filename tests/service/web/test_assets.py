"""What is the same for every client: files, and answers compressed for who takes that."""

from __future__ import annotations

import pytest
from fastapi import FastAPI
from starlette.responses import Response
from support.http_client import get

from service.publish.metrics import Metrics
from service.web.app import create_app

PLOTLY = "/static/plotly.min.js"


@pytest.fixture
def app() -> FastAPI:
    return create_app("htwg", {}, Metrics({}).registry)


@pytest.mark.parametrize("path", ["/static/style.css", "/static/icon.svg", PLOTLY])
def test_who_has_it_is_not_sent_it_again(app: FastAPI, path: str) -> None:
    first = get(app, path)
    assert first.status_code == 200
    again = get(app, path, headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("size", [10, 2_000, 300_000])
def test_answers_are_compressed_for_who_takes_that(app: FastAPI, size: int) -> None:
    app.add_route("/text", lambda request: Response(b"x" * size), include_in_schema=False)
    answer = get(app, "/text")
    assert answer.content == b"x" * size
    assert answer.headers.get("content-encoding") == ("gzip" if size > 1024 else None)
    assert int(answer.headers["content-length"]) <= size
    assert get(app, "/text", headers={"Accept-Encoding": "identity"}).headers["content-length"] == str(size)
