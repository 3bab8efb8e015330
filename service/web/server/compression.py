"""Answers compressed for clients that take that; large ones on another thread."""

from __future__ import annotations

import asyncio
import gzip
from functools import partial

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SMALLEST = 1024
"""Bytes from which an answer is compressed."""

INLINE = 65_536
"""Bytes up to which the event loop does it, in a millisecond or two."""

_LEVEL = 5


class Compress:
    """Middleware that compresses whole answers; what is compressed already, or streamed, goes out as it is."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or "gzip" not in Headers(scope=scope).get("accept-encoding", ""):
            await self._app(scope, receive, send)
            return
        start: Message | None = None

        async def compressed(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start":
                start = message
                return
            if start is not None:
                body = message.get("body", b"")
                headers = MutableHeaders(scope=start)
                whole = not message.get("more_body", False)
                if whole and len(body) >= SMALLEST and "content-encoding" not in headers:
                    compress = partial(gzip.compress, body, _LEVEL)
                    body = compress() if len(body) <= INLINE else await asyncio.to_thread(compress)
                    message = {**message, "body": body}
                    headers["Content-Encoding"] = "gzip"
                    headers["Content-Length"] = str(len(body))
                    headers.add_vary_header("Accept-Encoding")
                await send(start)
                start = None
            await send(message)

        await self._app(scope, receive, compressed)
