"""A request to an ASGI application in the same process: no socket between the two."""

from collections.abc import Iterable, Mapping
from http import HTTPStatus
from typing import Any, NamedTuple
from urllib.parse import quote

from starlette.types import ASGIApp, Message


class Answer(NamedTuple):
    status: int
    body: bytes

    @property
    def good(self) -> bool:
        """Whether the request was carried out."""
        return self.status < HTTPStatus.MULTIPLE_CHOICES


async def ask(
    app: ASGIApp,
    method: str,
    path: str,
    *,
    query: str = "",
    body: bytes = b"",
    headers: Iterable[tuple[bytes, bytes]] = (),
    state: Mapping[str, Any] | None = None,
) -> Answer:
    """What `app` answers to `method` on the unquoted `path` with JSON as its `body`, or raises. `headers` come on top
    of those of the body; `state` is what a guard before the routes would have put into the request."""
    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": path,
        "raw_path": quote(path).encode(),
        "root_path": "",
        "query_string": query.encode(),
        "headers": [(b"content-type", b"application/json"), (b"content-length", b"%d" % len(body)), *headers],
        "client": None,
        "server": None,
        "state": dict(state or {}),
    }
    received, sent = iter([{"type": "http.request", "body": body}]), list[Message]()

    async def receive() -> Message:
        return next(received, {"type": "http.disconnect"})

    async def send(message: Message) -> None:
        sent.append(message)

    await app(scope, receive, send)
    return Answer(sent[0]["status"], b"".join(message.get("body", b"") for message in sent))
