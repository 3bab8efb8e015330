"""What is the same for every client: read once, compressed once, kept."""

from __future__ import annotations

import asyncio
import gzip
import hashlib
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import NamedTuple

from starlette.requests import Request
from starlette.responses import Response

_WORTH_COMPRESSING = 1024


class _Content(NamedTuple):
    plain: bytes
    compressed: bytes
    tag: str


class Asset:
    """An answer that is the same for all; `answer` is the endpoint of its route."""

    def __init__(self, read: Callable[[], bytes], media_type: str, headers: Mapping[str, str] | None = None) -> None:
        """`read` is called once, on another thread, when the first client asks."""
        self._read = read
        self._media_type = media_type
        self._headers = dict(headers or {})
        self._content: _Content | None = None
        self._reading = threading.Lock()

    async def answer(self, request: Request) -> Response:
        """The content, compressed for whoever takes that; 304 for whoever has it."""
        content = self._content
        if content is None:
            content = await asyncio.to_thread(self._prepared)
        headers = self._headers | {"ETag": content.tag, "Vary": "Accept-Encoding"}
        if content.tag in request.headers.get("if-none-match", ""):
            return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=headers)
        body = content.plain
        if len(body) >= _WORTH_COMPRESSING and "gzip" in request.headers.get("accept-encoding", ""):
            body, headers["Content-Encoding"] = content.compressed, "gzip"
        return Response(body, headers=headers, media_type=self._media_type)

    def _prepared(self) -> _Content:
        with self._reading:
            content = self._content
            if content is None:
                plain = self._read()
                tag = f'"{hashlib.sha256(plain).hexdigest()[:32]}"'
                content = self._content = _Content(plain, gzip.compress(plain, mtime=0), tag)
            return content
