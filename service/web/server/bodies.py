"""The bodies of requests: taken in where a route reads them, whole, and within bounds."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from http import HTTPStatus

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.web.server.refusal import RequestRefused, refusal

AT_ONCE = 16
"""Bodies of the largest size that all clients together may have in memory; each may have an equal share of it."""

AT_ONCE_OF_ONE = 8
"""The same of one client."""

MAX_ITEMS = 100_000
"""Values in a JSON body. Each wrong one costs a validation error, and the event loop waits meanwhile."""

RETRY_SECONDS = 5

_CLOSE = {"Connection": "close"}
_SURROGATE = re.compile(rb"\\u[dD][89a-fA-F]")


class GatherBody:
    """Middleware that hands over the body of a request in one piece when the application asks for it.

    A body that is too large, has too much in it, or finds no room is refused. One that nobody asks for is not taken
    into memory.
    """

    def __init__(self, app: ASGIApp, limit: int) -> None:
        """`limit` of one body in bytes."""
        self._app = app
        self._limit = limit
        self._held: Counter[str] = Counter()
        """Bytes in memory by client."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope) if scope["type"] == "http" else {}
        if not ("content-length" in headers or "transfer-encoding" in headers):
            await self._app(scope, receive, send)
            return
        stated = headers.get("content-length", "0")
        if stated.isdecimal() and int(stated) > self._limit:
            await refusal(self._too_large())(scope, receive, send)
            return
        client = scope.get("state", {}).get("client", "")
        held, refused, ended = 0, False, False

        async def gathered() -> Message:
            nonlocal held, refused, ended
            if ended:
                return await receive()
            body, more = bytearray(), True
            while more:
                message = await receive()
                if message["type"] != "http.request":
                    return message  # The client has gone.
                piece = message.get("body", b"")
                body += piece
                held += len(piece)
                self._held[client] += len(piece)
                more = message.get("more_body", False)
                problem = self._problem(client, len(body)) or (None if more else _unread(headers, bytes(body)))
                if problem is not None:
                    await refusal(problem)(scope, receive, send)
                    # Whatever the application makes of it, the answer has been given.
                    refused = ended = True
                    return {"type": "http.disconnect"}
            ended = True
            return {"type": "http.request", "body": bytes(body), "more_body": False}

        async def unless_refused(message: Message) -> None:
            if not refused:
                await send(message)

        try:
            await self._app(scope, gathered, unless_refused)
        finally:
            self._held[client] -= held
            if not self._held[client]:
                del self._held[client]

    def _problem(self, client: str, size: int) -> RequestRefused | None:
        """Why no more of a body is taken in that has `size` bytes so far; None if it is."""
        if size > self._limit:
            return self._too_large()
        if self._held[client] > AT_ONCE_OF_ONE * self._limit:
            sentence = "you are sending too much at once; wait for answers before you send more"
            return RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], RETRY_SECONDS, _CLOSE)
        room = AT_ONCE * self._limit
        # Where there is too much in all, only who holds more than their share of it has to wait.
        if self._held.total() > room and self._held[client] * len(self._held) > room:
            sentence = "too much is being sent to the daemon at once; try again later"
            return RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], RETRY_SECONDS, _CLOSE)
        return None

    def _too_large(self) -> RequestRefused:
        sentence = f"the body is larger than {self._limit} bytes"
        return RequestRefused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, [sentence], headers=_CLOSE)


def _unread(headers: Mapping[str, str], body: bytes) -> RequestRefused | None:
    """As `unread_json`; None for a body that is no JSON, and for a packed one, which its route unpacks."""
    plain = "json" in headers.get("content-type", "") and "content-encoding" not in headers
    return unread_json(body) if plain else None


def unread_json(body: bytes) -> RequestRefused | None:
    """Why a JSON body is not even parsed; None if it is."""
    if sum(map(body.count, (b",", b"[", b"{"))) > MAX_ITEMS:
        sentence = f"the body has more than {MAX_ITEMS} values; send fewer at a time"
        return RequestRefused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, [sentence])
    try:
        document = json.loads(body, object_pairs_hook=_distinct)
        if _SURROGATE.search(body):
            json.dumps(document, ensure_ascii=False).encode()
    except _TwiceError as error:
        return RequestRefused(HTTPStatus.BAD_REQUEST, [f"the body has the key {str(error)[:60]!r} twice; give it once"])
    except UnicodeEncodeError:
        sentence = "the body has half a character in it, such as \\ud800; send text that is Unicode"
        return RequestRefused(HTTPStatus.BAD_REQUEST, [sentence])
    except (ValueError, RecursionError):
        return None  # For the application to explain.
    return None


class _TwiceError(Exception):
    """An object of JSON has a key twice: programs would read two things out of it."""


def _distinct(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found = dict(pairs)
    if len(found) < len(pairs):
        ((name, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise _TwiceError(name)
    return found
