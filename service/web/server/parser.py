"""h11's parser of requests, with bounds on the work that a request can make."""

from __future__ import annotations

import math
import re
import time
from http import HTTPStatus

import h11

FREE_CHUNKS = 1024
"""Chunks that every body may come in, whatever their size."""

CHUNK_BYTES = 256
"""What further chunks must hold on average."""

SLACK = 131_072
"""By how much a body may exceed its limit before the connection is given up, whether or not anyone reads it."""

_BLANK_LINE = re.compile(rb"\n\r?\n")


class Parser(h11.Connection):
    """The server's end of a connection, which stops at a `deadline` and refuses what no honest client sends.

    `refusal` says why, after `next_event` has raised h11.RemoteProtocolError.
    """

    def __init__(self, headers: int, body: int) -> None:
        """Limits in bytes."""
        super().__init__(h11.SERVER, headers)
        self._limits = headers, body
        self._chunks = self._received = 0
        self.deadline = math.inf
        """When to stop, monotonic s."""
        self.interrupted = False
        """Whether the last `next_event` stopped at the deadline."""
        self.refusal = HTTPStatus.BAD_REQUEST, "this is not an HTTP request"

    def next_event(self) -> h11.Event | type[h11.NEED_DATA] | type[h11.PAUSED]:
        """As of h11.Connection; NEED_DATA also at the deadline."""
        self.interrupted = time.monotonic() >= self.deadline
        if self.interrupted:
            return h11.NEED_DATA
        if self.their_state is h11.IDLE:
            self._check_head()
        event = super().next_event()
        if isinstance(event, h11.Request):
            self._check_request(event)
        elif isinstance(event, h11.Data):
            self._check_body(event)
        return event

    def _check_head(self) -> None:
        """h11 bounds headers only while their end has not come."""
        limit, _ = self._limits
        waiting = self.trailing_data[0]
        if len(waiting) > limit and not _BLANK_LINE.search(waiting, 0, limit):
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, f"the headers are longer than {limit} bytes")

    def _check_request(self, request: h11.Request) -> None:
        self._chunks = self._received = 0
        names = {name for name, _ in request.headers}
        if b"transfer-encoding" in names and (b"content-length" in names or request.http_version < b"1.1"):
            # Where two programs read a request's end differently, the second one may be smuggled in (RFC 9112, 6.1).
            sentence = "Transfer-Encoding goes with neither Content-Length nor HTTP/1.0; send one of them"
            self._refuse(HTTPStatus.BAD_REQUEST, sentence)

    def _check_body(self, data: h11.Data) -> None:
        self._chunks += data.chunk_start
        self._received += len(data.data)
        if self._chunks > FREE_CHUNKS + self._received // CHUNK_BYTES:
            sentence = f"the body comes in chunks of less than {CHUNK_BYTES} bytes; send it in larger ones or in one"
            self._refuse(HTTPStatus.BAD_REQUEST, sentence)
        _, limit = self._limits
        if self._received > limit + SLACK:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"the body is larger than {limit} bytes")

    def _refuse(self, status: HTTPStatus, sentence: str) -> None:
        self.refusal = status, sentence
        raise h11.RemoteProtocolError(sentence, error_status_hint=status)
