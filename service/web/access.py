"""Who may ask what over REST: API keys as bearer tokens (RFC 6750), refused before a route sees the request. A key in
the URL would end up in logs and histories."""

import asyncio
from collections.abc import Mapping
from http import HTTPStatus
from typing import Annotated

from fastapi import Depends, Request
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as Connection

from service.errors import KeyFileError
from service.records.asker import asked_by, current_asker
from service.records.view import ZoneView
from service.store.audit import AUDIT, about
from service.web.keys import Caller, Key, KeyRing, Scope
from service.web.limits import FailedAttempts
from service.web.server.peers import peer_of
from service.web.server.refusal import RequestRefused

OPEN_PATHS = ("/", "/docs", "/openapi.json", "/healthz")
"""Answered without a key: pages and documentation, which hold nothing of the site, and whether the process is alive."""
ADMIN_PREFIX = "/admin"
OF_ZONES = ("zones", "overview", "forecasts")
"""How the paths begin that a key for some zones may ask for; their answers are about zones that the caller sees."""
READINGS = "readings"
"""How every path ends where readings are posted; it needs a key, even where reading does not."""
MOST_NAMES = 20
"""Zones that an answer names at most; how many there are is told too."""
HOLD_SECONDS = 1.0
"""How long a wrong key waits for its answer where there were too many."""
KEYS_RETRY_SECONDS = 10

_REALM = 'Bearer realm="thermogate"'
ANYBODY = Caller(name="anybody")
"""Who asks without a key while none is in force."""
NOBODY = Caller(name="nobody", zones=())
"""Who asks for what is open without a key while keys are in force."""


async def caller_of(request: Request) -> Caller:
    """Dependency: who asks."""
    return request.scope["state"]["caller"]


Asking = Annotated[Caller, Depends(caller_of)]


class RequireKey:
    """Middleware that finds out who asks and lets nobody past who may not: what is not listed as open needs a key."""

    def __init__(self, app: ASGIApp, keys: KeyRing | None) -> None:
        """Without `keys` there are none: reading is open, administration closed."""
        self._app = app
        self._keys = keys
        self._attempts = FailedAttempts()

    async def __call__(self, connection: Connection, receive: Receive, send: Send) -> None:
        if connection["type"] == "http":
            try:
                caller = await self._caller(connection)
            except RequestRefused as refused:
                await refused.answer(connection, receive, send)
                return
            client = f"key {caller.name}" if isinstance(caller, Key) else peer_of(connection)
            connection.setdefault("state", {}).update(caller=caller, client=client)
            asker = current_asker()
            asker.name = client
            asked_by(asker)
            if isinstance(caller, Key):
                send = self._while_accepted(caller, send)
        await self._app(connection, receive, send)

    def _while_accepted(self, key: Key, send: Send) -> Send:
        """`send`, which ends a stream once its key is not accepted any more."""
        ended = False

        async def guarded(message: Message) -> None:
            nonlocal ended
            if ended:
                return
            if message.get("more_body", False) and not (self._keys and self._keys.accepts(key)):
                # The server tells the application that its client has gone.
                ended = True
                message = {"type": "http.response.body", "body": b"", "more_body": False}
            await send(message)

        return guarded

    async def _caller(self, connection: Connection) -> Caller:
        """Who asks; RequestRefused if they may not."""
        path: str = connection["path"]
        if path in OPEN_PATHS or path.startswith("/static/"):
            return self._known(connection)
        parts = [*path.split("/"), ""]
        writing = parts[1:-1] == [READINGS] or (parts[1] == "zones" and parts[3:-1] == [READINGS])
        needed: Scope = "admin" if f"/{parts[1]}" == ADMIN_PREFIX else "write" if writing else "read"
        if needed == "read" and not (self._keys and self._keys.in_force):
            return ANYBODY
        caller = await self._authenticated(connection)
        refused = None
        if not caller.may(needed):
            refused = _lacking(needed)
        elif caller.zones is not None and parts[1] not in OF_ZONES:
            refused = _lacking("all zones")
        elif caller.zones is not None and len(parts) > 3 and not caller.sees(parts[2]):
            refused = _unknown_zone(parts[2], sorted(caller.zones))
        if refused is not None:
            who = f"key {caller.name}"
            AUDIT.warning("%s was refused %s", who, path, extra=about("denied", who))
            raise refused
        return caller

    def _known(self, connection: Connection) -> Caller:
        try:
            if self._keys is None or not self._keys.in_force:
                return ANYBODY
            return self._keys.find(_secret(connection) or "") or NOBODY
        except KeyFileError:
            return NOBODY

    async def _authenticated(self, connection: Connection) -> Caller:
        secret = _secret(connection)
        if secret is None:
            raise RequestRefused(
                HTTPStatus.UNAUTHORIZED,
                ["this needs an API key; send it as Authorization: Bearer tg_..., made with `thermogate keys create`"],
                headers={"WWW-Authenticate": _REALM},
            )
        try:
            key = None if self._keys is None else self._keys.find(secret)
        except KeyFileError as error:
            raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [str(error)], retry_after=KEYS_RETRY_SECONDS) from None
        if key is not None:
            return key
        # Right keys are never held: nobody behind the same proxy can lock the others out, and 256 random bits are not
        # found by trying, at whatever rate. What is bounded is the noise.
        wait = self._attempts.count(peer_of(connection))
        headers = {"WWW-Authenticate": f'{_REALM}, error="invalid_token"'}
        if wait > 0:
            await asyncio.sleep(HOLD_SECONDS)
            sentence = f"too many wrong API keys from here; try again in {wait} s"
            raise RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [sentence], retry_after=wait, headers=headers)
        sentence = "this API key is wrong, revoked or expired; `thermogate keys list` shows the valid ones"
        raise RequestRefused(HTTPStatus.UNAUTHORIZED, [sentence], headers=headers)


def _secret(connection: Connection) -> str | None:
    """The key that a request was sent with."""
    scheme, _, secret = Headers(scope=connection).get("authorization", "").partition(" ")
    return secret.strip() if scheme.lower() == "bearer" else None


def find_zone(zones: Mapping[str, ZoneView], zone: str, caller: Caller) -> ZoneView:
    """The zone with the id `zone`; RequestRefused if there is none that the caller sees."""
    if zone not in zones or not caller.sees(zone):
        raise _unknown_zone(zone, [known for known in zones if caller.sees(known)])
    return zones[zone]


def _unknown_zone(zone: str, known: list[str]) -> RequestRefused:
    """A zone that does not exist, or not for this caller: the answer is the same, so that it tells nothing."""
    named, left = known[:MOST_NAMES], len(known) - MOST_NAMES
    more = f" and {left} more, which GET /zones lists" if left > 0 else ""
    sentence = f"there is no zone '{zone}'; the zones are {', '.join(named)}{more}"
    return RequestRefused(HTTPStatus.NOT_FOUND, [sentence], zones=named, zone_count=len(known))


def _lacking(scope: str) -> RequestRefused:
    return RequestRefused(
        HTTPStatus.FORBIDDEN,
        [f"this needs an API key for {scope}; make one with `thermogate keys create`"],
        headers={"WWW-Authenticate": f'{_REALM}, error="insufficient_scope"'},
    )
