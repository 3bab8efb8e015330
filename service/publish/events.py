"""Live events of the zones for the clients of REST that keep a connection open (server-sent events).

Every client has room for the newest event of each kind and for nothing else: who reads too slowly misses events that a
newer one has overtaken, and holds no memory. An event is written once for all clients of its zone.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from adapters.fields.times import written_time
from service.pauses import within
from service.publish.sinks import Announcement
from service.records.measures import Measure, single

KEEP_ALIVE = 15.0
"""After so many s without an event a comment is sent, so that proxies keep the connection and lost clients show."""

RECONNECT_MS = 3000
"""How long clients are asked to wait before they come back."""


class Event(NamedTuple):
    """One event: its kind, and the bytes that go over the wire."""

    kind: str
    data: bytes


def event(kind: str, payload: bytes, time: int | None) -> Event:
    """The document `payload` as an event, whose id is the sample time that it belongs to, UTC s."""
    stamp = None if time is None else written_time(time)
    return Event(kind, format_sse_event(event=kind, id=stamp, data_str=payload.decode()))


def events_of(announcement: Announcement) -> list[Event]:
    """What is announced, as events."""
    update = announcement.update
    time = None if update is None else update.time
    times = {"status": announcement.status.last_sample_time}
    return [event(topic, announcement.payload(topic), times.get(topic, time)) for topic in announcement.topics]


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
            if not await within(self._news, KEEP_ALIVE):
                yield KEEPALIVE_COMMENT
                continue
            self._news.clear()
            pending, self._pending = self._pending, {}
            if pending:
                yield b"".join(pending.values())


class Streams:
    """The open streams of all zones, which are opened and ended in the event loop: a sink."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._open: dict[str, set[Stream]] = {}
        self._ended = False
        self._overtaken = 0
        """Of the streams that are closed."""

    @property
    def overtaken(self) -> int:
        """How many events clients were too slow for."""
        # Asked from other threads than that of the event loop.
        return self._overtaken + sum(
            stream.overtaken for streams in tuple(self._open.values()) for stream in tuple(streams)
        )

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

    def add(self, zone: str) -> None:
        """Nothing to do: a zone's streams are opened by its clients."""

    def remove(self, zone: str) -> None:
        """End the streams of `zone`."""
        self._in_loop(lambda: self.end(zone))

    def publish(self, announcement: Announcement) -> None:
        """Leave what is announced for the clients of its zone."""
        if announcement.zone in self._open:
            events = events_of(announcement)
            self._in_loop(lambda: self._put(announcement.zone, events))

    def settle(self) -> None:
        """Nobody is waited for."""

    def measures(self) -> list[Measure]:
        """What clients were too slow for; how many streams are open is counted where that is bounded."""
        name = "thermogate_stream_events_overtaken"
        return [Measure(name, "counter", "Events that slow clients missed", (), lambda: single(float(self.overtaken)))]

    def close(self) -> None:
        """End all streams, for good."""
        self._in_loop(self.end)

    def _in_loop(self, work: Callable[[], None]) -> None:
        # Where the loop is gone, so are the clients.
        if self._loop is not None:
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(work)

    def _put(self, zone: str, events: list[Event]) -> None:
        for stream in self._open.get(zone, ()):
            stream.put(events)
