"""What one client may take of the daemon: streams."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from http import HTTPStatus

from fastapi import Request

from service.api_problems import RequestRefused

STREAMS_PER_CLIENT = 8
STREAMS = 64
STREAM_RETRY_SECONDS = 10


class StreamLimits:
    """How many streams are open, per client and in all."""

    def __init__(self, per_client: int = STREAMS_PER_CLIENT, total: int = STREAMS) -> None:
        self._per_client = per_client
        self._total = total
        self._open: Counter[str] = Counter()

    @property
    def open(self) -> int:
        """Streams that are open now."""
        return self._open.total()

    @contextmanager
    def admitted(self, client: str) -> Iterator[None]:
        """Count a stream of `client` while it lasts; RequestRefused if there are too many."""
        if self._open[client] >= self._per_client:
            raise RequestRefused(
                HTTPStatus.TOO_MANY_REQUESTS,
                [f"you have {self._per_client} streams open, which is the limit for one client; close one"],
                retry_after=STREAM_RETRY_SECONDS,
            )
        if self.open >= self._total:
            raise RequestRefused(
                HTTPStatus.SERVICE_UNAVAILABLE,
                [f"{self._total} streams are open, which is the limit; try again later"],
                retry_after=STREAM_RETRY_SECONDS,
            )
        self._open[client] += 1
        try:
            yield
        finally:
            self._open[client] -= 1
            if not self._open[client]:
                del self._open[client]


async def stream_slot(request: Request) -> AsyncIterator[None]:
    """Dependency of a route that streams: a place among the streams until its answer has ended, however it ends.

    RequestRefused (429 or 503) before the answer begins if there is none.
    """
    limits: StreamLimits = request.app.state.streams
    client = request.client
    with limits.admitted("local" if client is None else client.host):
        yield
