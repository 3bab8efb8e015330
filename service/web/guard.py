"""What every request has to pass and every answer carries: sizes, the host that is asked for, headers for browsers."""

import ipaddress
from collections import Counter
from collections.abc import Iterable
from http import HTTPStatus
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.config.http import HttpConfig
from service.store.audit import AUDIT, about
from service.web.server.peers import peer_of
from service.web.server.refusal import CLOSE, FAILED, RequestRefused

# plotly.js writes style attributes and draws its own images; everything else comes from this host.
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; object-src 'none'; "
        "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    # What is not static was true when it was asked for, and may have taken a key.
    "Cache-Control": "no-store",
}


class Guard:
    """Middleware that turns away what is too large or meant for another host, and adds HEADERS to every answer."""

    def __init__(self, app: ASGIApp, config: HttpConfig, answers: Counter[str] | None = None) -> None:
        self._app = app
        self._answers: Counter[str] = Counter() if answers is None else answers
        self._limits = config.limits
        self._hosts = frozenset((config.host, "localhost", *config.allowed_hosts))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        begun = False

        async def hardened(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                self._answers[str(message["status"])] += 1
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refused = self._refused(scope)
        if refused is not None:
            if refused.status in (HTTPStatus.FORBIDDEN, HTTPStatus.MISDIRECTED_REQUEST):
                peer = peer_of(scope)
                AUDIT.warning("%s was refused: %s", peer, refused, extra=about("another-site", peer))
            await refused.answer(scope, receive, hardened)
            return
        try:
            await self._app(scope, receive, hardened)
        except Exception:
            if not begun:
                await FAILED.answer(scope, receive, hardened)
            # For the log.
            raise

    def _refused(self, scope: Scope) -> RequestRefused | None:
        """Why this request gets no further; None if it does."""
        limits = self._limits
        if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > limits.url:
            sentence = f"the address with its query is longer than {limits.url} bytes"
            return RequestRefused(HTTPStatus.REQUEST_URI_TOO_LONG, [sentence], headers=CLOSE)
        if sum(len(name) + len(value) + 4 for name, value in scope["headers"]) > limits.headers:
            sentence = f"the headers are longer than {limits.headers} bytes"
            return RequestRefused(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, [sentence], headers=CLOSE)
        headers = Headers(scope=scope)
        if "transfer-encoding" in headers and ("content-length" in headers or scope["http_version"] < "1.1"):
            # Where two programs read a request's end differently, the second one may be smuggled in (RFC 9112, 6.1).
            sentence = "Transfer-Encoding goes with neither Content-Length nor HTTP/1.0; send one of them"
            return RequestRefused(HTTPStatus.BAD_REQUEST, [sentence], headers=CLOSE)
        asked = headers.getlist("host")
        if not all(_is_meant(host, self._hosts) for host in asked):
            sentence = "this name is not one of the daemon's; add it to http.allowed_hosts, or ask for the address"
            return RequestRefused(HTTPStatus.MISDIRECTED_REQUEST, [sentence])
        if _is_of_another_site(headers, asked):
            sentence = "a page of another site has sent this; open the address yourself, or ask without a browser"
            return RequestRefused(HTTPStatus.FORBIDDEN, [sentence], headers=CLOSE)
        return None


def _is_of_another_site(headers: Headers, hosts: Iterable[str]) -> bool:
    """Whether a browser sends this for a page of another site, which could not read the answer, but would take streams
    and time of whoever looks at it. To follow a link from there is the person's own wish."""
    asked = headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")
    if headers.get("sec-fetch-site") == "cross-site" and asked != ("navigate", "document"):
        return True
    # A link has no origin, the form of another site that is sent off has.
    names = set(map(_name_in, hosts))
    return any(_name_in(origin.partition("://")[2]) not in names for origin in headers.getlist("origin"))


def _name_in(host: str) -> str | None:
    """The name or address in a host with or without a port, in small letters; None if it is none."""
    try:
        parts = urlsplit(f"//{host}")
        whole = parts.netloc == host and parts.username is None and (parts.port is None or parts.port >= 0)
    except ValueError:
        return None
    return parts.hostname if whole else None


def _is_meant(host: str, hosts: Iterable[str]) -> bool:
    """Whether a Host header means this daemon. A page of somebody else that has its name resolve to this machine (DNS
    rebinding) sends that name; no page can send an address that it was not loaded from."""
    name = _name_in(host) or ""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name.removesuffix(".") in hosts
    return True
