"""One HTTP connection that cannot be held open by a client that is slow on purpose."""

from __future__ import annotations

import asyncio
import json
import logging
import math
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

import h11
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.config import Config
from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from service.config.http import LimitsConfig
from service.records.asker import Asker, asked_by
from service.web.server.parser import Parser
from service.web.server.refusal import MEDIA_TYPE
from service.web.server.turns import Account, Turns

MIN_PROGRESS = 65_536
"""Bytes of an answer that a client must take within send_timeout."""

PIECE = 65_536
"""How much of an answer its transport is given at once."""

READ_BYTES = 16_384
"""How much is read from a connection at once; more waits in the kernel, which makes the client wait."""

UNIX = "unix"
"""Whom requests over a UNIX socket come from."""

_log = logging.getLogger(__name__)
_log.setLevel(logging.ERROR)  # Requests that are not HTTP are their sender's business, at whatever rate they come.


class _Flow(FlowControl):
    """uvicorn's flow control, under which nothing more is read while what has come waits for its turn."""

    def __init__(self, transport: asyncio.Transport) -> None:
        super().__init__(transport)
        self._held = False

    def hold(self, held: bool) -> None:
        """Read nothing, or go on."""
        if held and not self.read_paused:
            self._transport.pause_reading()
        elif self._held and not held and not self.read_paused:
            self._transport.resume_reading()
        self._held = held

    def resume_reading(self) -> None:
        if self._held:
            self.read_paused = False
        else:
            super().resume_reading()


class Protocol(H11Protocol):
    """uvicorn's protocol with bounds on the time that a request takes to come in and an answer to go out, and on how
    long it holds the event loop.

    `check` has to be called now and then.
    """

    flow: _Flow
    conn: Parser

    def __init__(
        self,
        config: Config,
        state: ServerState,
        limits: LimitsConfig,
        turns: Turns,
        grown: Callable[[], None],
        lost: Callable[[], None],
        app: ASGIApp | None,
    ) -> None:
        """`turns` shares the loop between the connections; `app` answers instead of the configured one. `grown` is
        called when a large answer begins to wait for its client, `lost` when the connection has ended."""
        super().__init__(config, state, {})
        self.app = self._in_pieces(app or config.loaded_app)
        self.logger = _log
        self.conn = Parser(limits.headers, limits.body)
        self.account = Account()
        self._turns = turns
        self._limits = limits
        self._grown = grown
        self._lost = lost
        self._layers: list[asyncio.WriteTransport] = []
        self._receiving_since: float | None = None
        """When the request began that is not complete yet."""
        self._unparsed = 0
        """Bytes that have come since the connection had its last turn."""
        self._asker = Asker()
        """Of the request that is being answered."""
        self._owed = 0
        """Bytes of the answer that the transport has not been given yet."""
        self._unsent = 0
        self._progress = 0.0
        """How much of the answer was waiting when the client last made progress, and when that was."""
        self.met = False
        """Whether the connection, with its handshake, has come about."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self.met = True
        self.flow = _Flow(transport)
        self.client = self.client or (UNIX, 0)
        # asyncio's TLS hands a large answer down at once and then knows of none; it waits in the transport below.
        encryption = getattr(transport, "_ssl_protocol", None)
        self._layers = [transport] if encryption is None else [transport, encryption._transport]
        if encryption is None:
            transport.max_size = READ_BYTES
        else:
            # A quarter of a megabyte each, in the buffer for the socket and in that for what is not read yet.
            encryption.max_size = READ_BYTES
            encryption._ssl_buffer = bytearray(READ_BYTES)
            encryption._ssl_buffer_view = memoryview(encryption._ssl_buffer)
            transport.set_read_buffer_limits(high=READ_BYTES)
        self._receiving_since = self._progress = self.loop.time()

    def data_received(self, data: bytes) -> None:
        self._unparsed += len(data)
        super().data_received(data)

    def handle_events(self) -> None:
        """Read what has come, when it is this connection's turn; no more is taken in until then."""
        self._turns.ask(self)
        if self._unparsed >= READ_BYTES:
            self.flow.hold(True)

    def take_turn(self, deadline: float) -> bool:
        """Read what has come until `deadline` (monotonic s); whether there is more."""
        if self.transport.is_closing():
            return False
        self._unparsed = 0
        self.conn.deadline = deadline
        super().handle_events()
        waits = self.conn.interrupted and not self.transport.is_closing()
        self.flow.hold(waits)
        state = self.conn.their_state
        if not (state is h11.SEND_BODY or (state is h11.IDLE and self.conn.trailing_data[0])):
            self._receiving_since = None
        elif self._receiving_since is None:
            self._receiving_since = self.loop.time()
        return waits

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._turns.leave(self)
        self._asker.gone.set()
        self._lost()

    def resume_writing(self) -> None:
        super().resume_writing()
        self._progress = self.loop.time()

    @property
    def stalled_since(self) -> float:
        """When the client last made progress with what waits for it; infinite if nothing does."""
        return self._progress if self.unsent else math.inf

    @property
    def unsent(self) -> int:
        """Bytes that wait for the client to take them."""
        return self._owed + sum(layer.get_write_buffer_size() for layer in self._layers)

    def _in_pieces(self, app: ASGIApp) -> ASGIApp:
        """`app`, whose answers are given to the transport as fast as the client takes them: the transport would copy
        the rest."""

        async def paced(scope: Scope, receive: Receive, send: Send) -> None:
            async def in_pieces(message: Message) -> None:
                body = message.get("body", b"")
                if len(body) <= PIECE:
                    await send(message)
                    return
                if not self.unsent:
                    self._unsent, self._progress = 0, self.loop.time()
                self._owed = len(body)
                self._grown()
                try:
                    for begin in range(0, len(body), PIECE):
                        more = begin + PIECE < len(body) or message.get("more_body", False)
                        await send({**message, "body": body[begin : begin + PIECE], "more_body": more})
                        self._owed -= PIECE
                        if self.transport.is_closing():
                            return
                        # The system may take megabytes at once, and other answers wait.
                        await asyncio.sleep(0)
                finally:
                    self._owed = 0

            asker = self._asker = Asker()
            asked_by(asker)
            try:
                await app(scope, receive, in_pieces)
            finally:
                self._asker = Asker()

        return paced

    def check(self, now: float) -> str | None:
        """End the connection if the client is too slow; in what, or None."""
        unsent = self.unsent
        if unsent == 0 or unsent <= self._unsent - MIN_PROGRESS or self._unsent == 0:
            self._unsent, self._progress = unsent, now
        elif now - self._progress > self._limits.send_timeout:
            self.transport.abort()
            return "slow to read"
        late = self._receiving_since is not None and now - self._receiving_since > self._limits.receive_timeout
        if late and not self.transport.is_closing():
            begun = self.conn.their_state is not h11.IDLE or self.conn.trailing_data[0]
            if begun:
                seconds = f"{self._limits.receive_timeout:g} s"
                self._refuse(HTTPStatus.REQUEST_TIMEOUT, f"the request was not complete within {seconds}")
            self.transport.close()
            return "slow to ask"
        return None

    def send_400_response(self, msg: str) -> None:
        self._refuse(*self.conn.refusal)

    def _refuse(self, status: HTTPStatus, detail: str) -> None:
        """Answer with a problem and close, past the application; only close where an answer has begun."""
        answered = self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE)
        if answered or (self.scope is not None and self.scope["method"] == "HEAD"):
            self.transport.close()
            return
        document = {"type": "about:blank", "title": status.phrase, "status": int(status), "detail": detail}
        body = json.dumps(document).encode()
        headers = [("Content-Type", MEDIA_TYPE), ("Content-Length", str(len(body))), ("Connection", "close")]
        for event in (
            h11.Response(status_code=status, headers=headers, reason=status.phrase.encode()),
            h11.Data(data=body),
            h11.EndOfMessage(),
        ):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()
