"""Requests to an ASGI application, without a server and without another dependency."""

import asyncio
from typing import Any

import httpx
from fastapi import FastAPI


def request(app: FastAPI, method: str, url: str, **options: Any) -> httpx.Response:
    """The answer of `app`; an unhandled error gives the 500 that a client would see."""

    async def send() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.request(method, url, **options)

    return asyncio.run(send())


def get(app: FastAPI, url: str, **options: Any) -> httpx.Response:
    return request(app, "GET", url, **options)


def post(app: FastAPI, url: str, body: object) -> httpx.Response:
    return request(app, "POST", url, json=body)


def scope(method: str, path: str, headers: dict[str, str]) -> dict[str, Any]:
    """What an ASGI application is called with for a request from this machine."""
    named = [(name.lower().encode(), text.encode()) for name, text in {"Host": "localhost", **headers}.items()]
    about = {"type": "http", "http_version": "1.1", "method": method, "scheme": "http", "headers": named, "state": {}}
    place = {"path": path, "raw_path": path.encode(), "query_string": b"", "root_path": ""}
    return {**about, **place, "client": ("127.0.0.1", 1), "server": ("localhost", 80)}


def problem(answer: httpx.Response, status: int) -> dict[str, Any]:
    """The problem document of `answer`, after checking its form."""
    assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")
    document: dict[str, Any] = answer.json()
    assert document["status"] == status
    assert document["title"]
    assert document["detail"]
    return document
