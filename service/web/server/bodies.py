"""The bodies of requests: taken in where a route reads them, whole, and within bounds."""

import json
import re
from collections import Counter
from http import HTTPStatus

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from adapters.payload.objects import KeyTwice, distinct
from service.web.server.refusal import CLOSE, RequestRefused

AT_ONCE = 16
"""Bodies of the largest size that all clients together may have in memory; each may have an equal share of it."""
AT_ONCE_OF_ONE = 8
"""The same of one client."""
MAX_ITEMS = 100_000
"""Values in a JSON body. Each wrong one costs a validation error, and the event loop waits meanwhile."""
RETRY_SECONDS = 5
PACKED = b"\x1f\x8b"
"""How a body begins that is packed with gzip, and no JSON does."""
_SURROGATE = re.compile(rb"\\u[dD][89a-fA-F]")


class GatherBody:
    """Middleware that hands over the body of a request in one piece when the application asks for it, and takes none
    else into memory; RequestRefused if it is too large, has too much in it, or finds no room."""

    def __init__(self, app: ASGIApp, limit: int) -> None:
        self._app = app
        self._limit = limit
        self._held: Counter[str] = Counter()
        """Bytes in memory by client."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope) if scope["type"] == "http" else Headers()
        stated = headers.get("content-length", "0")
        if stated.isdecimal() and int(stated) > self._limit:
            await self._too_large().answer(scope, receive, send)
            return
        client, held, ended = scope.get("state", {}).get("client", ""), 0, False

        async def gathered() -> Message:
            nonlocal held, ended
            body, more = bytearray(), not ended
            if ended:
                return await receive()
            while more:
                message = await receive()
                if message["type"] != "http.request":
                    return message  # The client has gone.
                piece, more = message.get("body", b""), message.get("more_body", False)
                body += piece
                held += len(piece)
                self._held[client] += len(piece)
                self._check(client, len(body))
            ended = True
            # A packed body is unpacked by its route.
            if "json" in headers.get("content-type", "").lower() and not body.startswith(PACKED):
                check_json(bytes(body))
            return {"type": "http.request", "body": bytes(body), "more_body": False}

        # What comes with a GET is for no route to read.
        bodied = "content-length" in headers or "transfer-encoding" in headers
        try:
            await self._app(scope, gathered if bodied and scope["method"] != "GET" else receive, send)
        finally:
            self._held[client] -= held
            if not self._held[client]:
                del self._held[client]

    def _check(self, client: str, size: int) -> None:
        """RequestRefused where no more of a body is taken in that has `size` bytes so far."""
        if size > self._limit:
            raise self._too_large()
        if self._held[client] > AT_ONCE_OF_ONE * self._limit:
            sentence = "you are sending too much at once; wait for answers before you send more"
            raise RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], RETRY_SECONDS, CLOSE)
        room = AT_ONCE * self._limit
        # Where there is too much in all, only who holds more than their share of it has to wait.
        if self._held.total() > room and self._held[client] * len(self._held) > room:
            sentence = "too much is being sent to the daemon at once; try again later"
            raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], RETRY_SECONDS, CLOSE)

    def _too_large(self) -> RequestRefused:
        sentence = f"the body is larger than {self._limit} bytes"
        return RequestRefused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, [sentence], headers=CLOSE)


def check_json(body: bytes) -> None:
    """RequestRefused for a JSON body that is not even parsed."""
    if sum(map(body.count, (b",", b"[", b"{"))) > MAX_ITEMS:
        sentence = f"the body has more than {MAX_ITEMS} values; send fewer at a time"
        raise RequestRefused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, [sentence])
    try:
        document = json.loads(body, object_pairs_hook=distinct)
        if not body.isascii() or b"\0" in body or _SURROGATE.search(body):
            json.dumps(document, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        sentence = "the body has half a character in it, such as \\ud800; send text that is Unicode"
        raise RequestRefused(HTTPStatus.BAD_REQUEST, [sentence]) from None
    except KeyTwice as error:
        raise RequestRefused(HTTPStatus.BAD_REQUEST, [f"the body {error}"]) from None
    except (ValueError, RecursionError):
        pass  # For the application to explain.
