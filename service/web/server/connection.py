"""One HTTP connection: uvicorn's, with bounds on what a slow or greedy client may take."""

import asyncio
import logging
import math
import sys
import time
from collections import deque
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

import h11
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from service.config.http import LimitsConfig
from service.records.asker import Asker, asked_by
from service.web.server.refusal import CLOSE, RequestRefused

FREE_CHUNKS = 64
"""Chunks that every body may come in, whatever their size."""
CHUNK_BYTES = 256
"""What further chunks must hold on average: parsing one costs as much as reading that."""
READ_BYTES = 16_384
"""How much is read from a connection at once; more waits in the kernel, which makes the client wait."""
PASS_SECONDS = 0.002
"""How long connections may hold one pass of the event loop between them."""
PIECE = 65_536
"""How much of an answer its transport is given at once; it would copy the rest."""
MIN_PROGRESS = 65_536
"""Bytes of an answer that a client must take within send_timeout."""
UNIX = "unix"
"""Whom requests over a UNIX socket come from."""

_log = logging.getLogger(__name__)
_log.setLevel(logging.ERROR)  # Requests that are not HTTP are their sender's business, at whatever rate they come.


class _TinyChunksError(h11.RemoteProtocolError):
    """What a body in tiny chunks is refused with."""


class Parser(h11.Connection):
    """h11's parser of requests, which refuses bodies in tiny chunks."""

    def __init__(self, headers: int) -> None:
        """`headers` is the limit of a request without its body, in bytes."""
        super().__init__(h11.SERVER, headers)
        self._chunks = self._received = 0

    def next_event(self) -> h11.Event | type[h11.NEED_DATA] | type[h11.PAUSED]:
        event = super().next_event()
        if isinstance(event, h11.Request):
            self._chunks = self._received = 0
        elif isinstance(event, h11.Data):
            self._chunks += event.chunk_start
            self._received += len(event.data)
            if self._chunks > FREE_CHUNKS + self._received // CHUNK_BYTES:
                sentence = f"the body comes in chunks of less than {CHUNK_BYTES} bytes; send it in larger ones"
                raise _TinyChunksError(sentence)
        return event


class Passes:
    """Lets connections parse what has come one after the other, as many as fit one pass of the event loop."""

    def __init__(self) -> None:
        self._waiting: deque[Callable[[], None]] = deque()

    def add(self, work: Callable[[], None]) -> None:
        """Do `work` soon, after what was added before."""
        self._waiting.append(work)
        if len(self._waiting) == 1:
            asyncio.get_running_loop().call_soon(self._run)

    def _run(self) -> None:
        last = time.monotonic() + PASS_SECONDS
        try:
            while self._waiting and time.monotonic() < last:
                # First of the queue until it is done: whatever is added meanwhile needs no pass of its own.
                try:
                    self._waiting[0]()
                finally:
                    self._waiting.popleft()
        finally:
            if self._waiting:
                asyncio.get_running_loop().call_soon(self._run)


class ClosedOnce:
    """A transport that may be closed again: an encrypted one would then forget what it is still sending."""

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def close(self) -> None:
        """Close the transport, unless that has begun."""
        if not self._transport.is_closing():
            self._transport.close()

    def let_go(self) -> None:
        """Of a lost connection: let an encrypted transport forget its protocol, which refers to it."""
        self._transport.close()


class Connection(H11Protocol, asyncio.BufferedProtocol):
    """A connection that ends where a request is too slow to come in or an answer to go out; `check` sees to that."""

    conn: Parser

    def __init__(
        self,
        server: tuple[Config, ServerState],
        limits: LimitsConfig,
        passes: Passes,
        grown: Callable[[], None],
        lost: Callable[[], None],
        app: ASGIApp | None = None,
    ) -> None:
        """`app` answers instead of the server's. `grown` is called when a large answer begins to wait for its client,
        `lost` when the connection has ended."""
        super().__init__(*server, {})
        self.app = app or self.app
        self.logger = _log
        self.conn = Parser(limits.headers)
        self._limits, self._passes, self._grown, self._lost = limits, passes, grown, lost
        self._buffer = memoryview(bytearray(READ_BYTES))
        self._arrived = bytearray()
        self._receiving_since: float | None = None
        """When the request began that is not complete yet."""
        self._asker = Asker()
        """Of the request that is being answered."""
        self._owed = 0
        """Bytes of the answer that the transport has not been given yet."""
        self._unsent, self._progress = 0, 0.0
        """How much of the answer was waiting when the client last made progress, and when that was."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        self._closed_once = ClosedOnce(transport)
        super().connection_made(self._closed_once)  # type: ignore[arg-type]
        self.app = self._paced(self.app)
        if self.scheme == "https":
            # Left to itself it keeps 256 kB of what is read and 512 kB of what is written.
            transport.set_read_buffer_limits(READ_BYTES)  # type: ignore[attr-defined]
            transport.set_write_buffer_limits(PIECE)
        self.client = self.client or (UNIX, 0)
        self._receiving_since = self._progress = self.loop.time()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._asker.gone.set()
        self._lost()
        # They refer to the connection, and would keep it and its buffers until garbage is collected.
        del self.app
        self.cycle = None  # type: ignore[assignment]
        self._unset_keepalive_if_required()
        self._closed_once.let_go()

    def resume_writing(self) -> None:
        super().resume_writing()
        self._progress = self.loop.time()

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Keep what was read until it is this connection's turn, and read no more until then."""
        if not self._arrived:
            self._passes.add(self._parse)
        self._arrived += self._buffer[:nbytes]
        self.transport.pause_reading()

    def _parse(self) -> None:
        arrived, self._arrived = bytes(self._arrived), bytearray()
        if self.transport.is_closing():
            return
        self.data_received(arrived)
        incomplete = self.conn.their_state is h11.SEND_BODY or self._begun
        self._receiving_since = (self._receiving_since or self.loop.time()) if incomplete else None
        if not (self.flow.read_paused or self.transport.is_closing()):
            self.transport.resume_reading()

    @property
    def _begun(self) -> bool:
        """Whether there is a part of the head of a request."""
        return self.conn.their_state is h11.IDLE and bool(self.conn.trailing_data[0])

    @property
    def unsent(self) -> int:
        """Bytes that wait for the client to take them."""
        return self._owed + self.transport.get_write_buffer_size()

    @property
    def stalled_since(self) -> float:
        """When the client last made progress with what waits for it; infinite if nothing does."""
        return self._progress if self.unsent else math.inf

    def _paced(self, app: ASGIApp) -> ASGIApp:
        """`app`, whose answers are given to the transport as fast as the client takes them."""

        async def paced(scope: Scope, receive: Receive, send: Send) -> None:
            begun = False

            async def in_pieces(message: Message) -> None:
                nonlocal begun
                begun = True
                body = message.get("body", b"")
                if len(body) <= PIECE or asker.gone.is_set():
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
            except asyncio.CancelledError:
                # uvicorn cancels what is not done in time at a stop, and would log a traceback.
                if not begun:
                    sentence = "the daemon is stopping; ask again when it runs"
                    refused = RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], headers=CLOSE)
                    await refused.answer(scope, receive, send)
            finally:
                self._asker = Asker()

        return paced

    def check(self, now: float) -> str | None:
        """End the connection if the client is too slow; in what, or None. To be called now and then."""
        unsent = self.unsent
        if unsent == 0 or unsent <= self._unsent - MIN_PROGRESS or self._unsent == 0:
            self._unsent, self._progress = unsent, now
        elif now - self._progress > self._limits.send_timeout:
            self.transport.abort()
            return "slow to read"
        late = self._receiving_since is not None and now - self._receiving_since > self._limits.receive_timeout
        if not late or self.transport.is_closing():
            return None
        if self._begun or self.conn.their_state is not h11.IDLE:
            sentence = f"the request was not complete within {self._limits.receive_timeout:g} s"
            self._refuse(HTTPStatus.REQUEST_TIMEOUT, sentence)
        self.transport.close()
        return "slow to ask"

    def send_400_response(self, msg: str) -> None:
        """Answer what is not HTTP with a problem, while the parser's error is handled."""
        error = sys.exception()
        assert isinstance(error, h11.RemoteProtocolError), "uvicorn calls this for nothing else"
        status, sentence = HTTPStatus(error.error_status_hint), "this is not HTTP"
        if isinstance(error, _TinyChunksError):
            sentence = str(error)
        elif status == HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE:
            sentence = "the headers, or the line before a chunk, are too long"
        elif status == HTTPStatus.NOT_IMPLEMENTED:
            sentence = "the only Transfer-Encoding that is read is chunked"
        self._refuse(status, sentence)
        # h11 raises it in a frame that holds it, so that both would keep the connection until garbage is collected.
        error.__traceback__ = None

    def _refuse(self, status: HTTPStatus, detail: str) -> None:
        """Answer with a problem and close, past the application; only close where an answer has begun."""
        answered = self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE)
        if not answered and (self.scope is None or self.scope["method"] != "HEAD"):
            answer = RequestRefused(status, [detail], headers=CLOSE).answer
            head = h11.Response(status_code=status, headers=answer.raw_headers, reason=status.phrase.encode())
            for event in (head, h11.Data(data=bytes(answer.body)), h11.EndOfMessage()):
                self.transport.write(self.conn.send(event) or b"")
            if self.cycle is not None:
                # The application has not answered yet, and what it will say has no place any more.
                self.cycle.disconnected = True
        self.transport.close()
