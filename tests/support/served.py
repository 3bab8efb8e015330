"""The real HTTP server on a free port, and clients that speak to it byte by byte."""

import asyncio
import contextlib
import json
import ssl
from collections.abc import AsyncIterator
from typing import Any, NamedTuple, Self

from fastapi import FastAPI

from service.config.http import HttpConfig
from service.web.server.server import HttpServer


class Answer(NamedTuple):
    """An answer as it came over the wire."""

    status: int
    headers: dict[str, str]
    body: bytes

    def problem(self) -> str:
        """The detail of a problem document."""
        assert self.headers["content-type"] == "application/problem+json"
        document = json.loads(self.body)
        assert document["status"] == self.status
        return str(document["detail"])


@contextlib.asynccontextmanager
async def serving(app: FastAPI, config: HttpConfig) -> AsyncIterator[HttpServer]:
    """`app` on `config`; clients that are connected meanwhile are closed at the end."""
    server = HttpServer(app, config)
    task = asyncio.create_task(server.run())
    try:
        await server.started(task)
        yield server
    finally:
        await server.stop(task)
        for client in _OPEN:
            await client.close()
        _OPEN.clear()


def config(**settings: Any) -> HttpConfig:
    """[http] with `settings` for a server on a free port."""
    return HttpConfig.model_validate({"port": 0} | settings, context={"folder": "/"})


class Client:
    """One connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    @classmethod
    async def to(cls, server: HttpServer, context: ssl.SSLContext | None = None, limit: int = 2**16) -> Self:
        port = int(server.url.rpartition(":")[2])
        # Of other kinds, tests read what came until the very end, and close them.
        client = cls(*await asyncio.open_connection("127.0.0.1", port, ssl=context, limit=limit))
        if cls is Client:
            _OPEN.append(client)
        return client

    async def send(self, content: bytes) -> None:
        self.writer.write(content)
        await self.writer.drain()

    async def ask(self, path: str = "/", **headers: str) -> Answer:
        lines = [f"GET {path} HTTP/1.1", "Host: localhost", *(f"{name}: {value}" for name, value in headers.items())]
        await self.send("".join(f"{line}\r\n" for line in [*lines, ""]).encode())
        return await self.answer()

    async def answer(self) -> Answer:
        head = (await asyncio.wait_for(self.reader.readuntil(b"\r\n\r\n"), 180)).decode().split("\r\n")
        headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in head[1:-2])}
        body = await self.reader.readexactly(int(headers.get("content-length", 0)))
        return Answer(int(head[0].split()[1]), headers, body)

    async def ended(self, seconds: float = 180) -> bytes:
        """What still comes until the server closes; fails if it does not."""
        try:
            return await asyncio.wait_for(self.reader.read(), seconds)
        except ConnectionError:
            return b""

    async def close(self) -> None:
        self.writer.close()
        with contextlib.suppress(OSError):
            await self.writer.wait_closed()


_OPEN: list[Client] = []


async def ask(server: HttpServer, path: str = "/", context: ssl.SSLContext | None = None, **headers: str) -> Answer:
    """The answer to a GET on a connection of its own."""
    client = await Client.to(server, context)
    try:
        return await client.ask(path, **headers)
    finally:
        await client.close()
