"""Live events of the zones for the clients of REST that keep a connection open (server-sent events).

Every client has room for the newest event of each kind and for nothing else: who reads too slowly misses events that a
newer one has overtaken, and holds no memory. An event is written once for all clients of its zone.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from typing import NamedTuple

from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from service.publish.payloads import Payload, to_json
from service.publish.rendering import forecast_payload, gate_payload, status_payload, utc, volatility_payload, vouched
from service.records.status import ZoneStatus
from service.records.update import Update

KEEP_ALIVE = 15.0
"""After so many s without an event a comment is sent, so that proxies keep the connection and lost clients show."""

RECONNECT_MS = 3000
"""How long clients are asked to wait before they come back."""


class Event(NamedTuple):
    """One event: its kind, and the bytes that go over the wire."""

    kind: str
    data: bytes


def event(kind: str, payload: Payload, time: datetime | None) -> Event:
    """`payload` as an event, whose id is the sample time that it belongs to."""
    stamp = None if time is None else time.isoformat().replace("+00:00", "Z")
    return Event(kind, format_sse_event(event=kind, id=stamp, data_str=to_json(payload).decode()))


def events_of(site: str, zone: str, status: ZoneStatus, update: Update | None) -> list[Event]:
    """What Zenoh has on the keys of a zone, as events, in the order in which it is published there."""
    return [*_update_events(site, zone, status, update), _status_event(site, zone, status, update)]


class Stream:
    """What one client has not been sent yet."""

    def __init__(self) -> None:
        self.overtaken = 0
        """How many events this client missed, because newer ones of their kind came before it had read."""
        self._pending: dict[str, bytes] = {}
        self._news = asyncio.Event()
        self._ended = False

    def put(self, events: Iterable[Event]) -> None:
        """Leave `events` for the client; each takes the place of an older one of its kind."""
        for kind, data in events:
            if self._pending.pop(kind, None) is not None:
                self.overtaken += 1
            self._pending[kind] = data
        self._news.set()

    def end(self) -> None:
        """Let the stream end after what is pending."""
        self._ended = True
        self._news.set()

    async def read(self) -> AsyncIterator[bytes]:
        """What the client is to be sent, as it comes, until the stream ends."""
        yield format_sse_event(retry=RECONNECT_MS)
        while self._pending or not self._ended:
            try:
                async with asyncio.timeout(KEEP_ALIVE):
                    await self._news.wait()
            except TimeoutError:
                yield KEEPALIVE_COMMENT
                continue
            self._news.clear()
            pending, self._pending = self._pending, {}
            if pending:
                yield b"".join(pending.values())


class Streams:
    """The open streams of all zones; made in the event loop. An announcer: `publish` and `publish_status` may come
    from any thread."""

    def __init__(self, site: str) -> None:
        self._site = site
        self._loop: asyncio.AbstractEventLoop | None = None
        self._open: dict[str, set[Stream]] = {}
        self._ended = False
        self._overtaken = 0

    @property
    def count(self) -> int:
        """How many are open."""
        return sum(map(len, tuple(self._open.values())))

    @property
    def overtaken(self) -> int:
        """How many events clients were too slow for."""
        return self._overtaken + sum(stream.overtaken for streams in tuple(self._open.values()) for stream in streams)

    @contextmanager
    def opened(self, zone: str) -> Iterator[Stream]:
        """A stream of `zone`'s events from now on, for as long as the context lasts."""
        self._loop = asyncio.get_running_loop()
        stream = Stream()
        if self._ended:
            stream.end()
        self._open.setdefault(zone, set()).add(stream)
        try:
            yield stream
        finally:
            self._overtaken += stream.overtaken
            # The zone may have been ended meanwhile, and opened anew.
            if zone in self._open:
                self._open[zone].discard(stream)
                if not self._open[zone]:
                    del self._open[zone]

    def end(self, zone: str | None = None) -> None:
        """End the streams of `zone`; None: all, for good, as the daemon stops."""
        self._ended = self._ended or zone is None
        for name, streams in self._open.items():
            if zone in (None, name):
                for stream in streams:
                    stream.end()

    def publish(self, zone: str, update: Update, status: ZoneStatus) -> None:
        """A sample was assimilated."""
        if zone in self._open:
            self._hand_over(zone, events_of(self._site, zone, status, update))

    def publish_status(self, zone: str, status: ZoneStatus, update: Update | None = None) -> None:
        """The status alone has changed."""
        if zone in self._open:
            self._hand_over(zone, [_status_event(self._site, zone, status, update)])

    def _hand_over(self, zone: str, events: list[Event]) -> None:
        # Where the loop is gone, so are the clients.
        if self._loop is not None:
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._put, zone, events)

    def _put(self, zone: str, events: list[Event]) -> None:
        for stream in self._open.get(zone, ()):
            stream.put(events)


def _update_events(site: str, zone: str, status: ZoneStatus, update: Update | None) -> list[Event]:
    if update is None:
        return []
    time = utc(update.time)
    return [
        event("forecast", vouched(forecast_payload(site, zone, update), status), time),
        event("volatility", volatility_payload(site, zone, update), time),
        event("gate", gate_payload(site, zone, update), time),
    ]


def _status_event(site: str, zone: str, status: ZoneStatus, update: Update | None) -> Event:
    last = status.last_sample_time
    return event("status", status_payload(site, zone, status, update), None if last is None else utc(last))
