"""Live events of the zones for clients that keep a connection open (server-sent events), written once for all of a
zone. Every client has room for the newest event of each kind, or, where it watches all zones, for the names of those
with news: one that reads too slowly misses events and holds no memory."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from adapters.fields.times import written_time
from service.pauses import within
from service.publish.language import LANGUAGES
from service.publish.payloads import AheadPayload
from service.publish.sinks import Announcement, Sink
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


def events_of(announcement: Announcement, language: str = LANGUAGES[0]) -> list[Event]:
    """What is announced, as events in `language`."""
    update = announcement.update
    time = None if update is None else update.time
    times = {"status": announcement.status.last_sample_time}
    return [
        event(topic, announcement.payload(topic, language), times.get(topic, time)) for topic in announcement.topics
    ]


class Stream:
    """What one client, who reads `language`, has not been sent yet."""

    def __init__(self, language: str = LANGUAGES[0]) -> None:
        self.language = language
        self._pending: dict[str, bytes] = {}
        self._news = asyncio.Event()
        self._over = asyncio.Event()

    @property
    def ended(self) -> bool:
        """Whether nothing more will come."""
        return self._over.is_set()

    def put(self, events: Iterable[Event]) -> int:
        """Leave `events` for the client, each in the place of an older one of its kind; how many of these it missed."""
        overtaken = 0
        for kind, data in events:
            overtaken += self._pending.pop(kind, None) is not None
            self._pending[kind] = data
        self._news.set()
        return overtaken

    def end(self) -> None:
        """Let the stream end after what is pending."""
        self._over.set()
        self._news.set()

    async def rest(self, seconds: float) -> None:
        """Let news gather for so long, or until the end."""
        await within(self._over, seconds)

    async def news(self) -> dict[str, bytes]:
        """What is pending by kind, longest ago first, once there is anything; nothing after KEEP_ALIVE s without."""
        await within(self._news, KEEP_ALIVE)
        self._news.clear()
        pending, self._pending = self._pending, {}
        return pending

    async def read(self) -> AsyncIterator[bytes]:
        """What the client is to be sent, as it comes, until the stream ends."""
        yield format_sse_event(retry=RECONNECT_MS)
        while self._pending or not self.ended:
            pending = await self.news()
            if pending or not self.ended:
                yield b"".join(pending.values()) or KEEPALIVE_COMMENT


EVERY_ZONE = ""
"""Whose stream has the id of every zone with news, as a kind of event without content."""


class Streams(Sink):
    """The open streams of all zones, which are opened and ended in the event loop."""

    def __init__(self) -> None:
        self.overtaken = 0
        """How many events clients were too slow for."""
        self.ahead: dict[str, AheadPayload] = {}
        """The newest hours ahead of every zone."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._open: dict[str, set[Stream]] = {}
        self._ended = False

    @contextmanager
    def opened(self, zone: str = EVERY_ZONE, language: str = LANGUAGES[0]) -> Iterator[Stream]:
        """A stream of `zone`'s events in `language` from now on, for as long as the context lasts."""
        self._loop = asyncio.get_running_loop()
        stream = Stream(language)
        if self._ended:
            stream.end()
        self._open.setdefault(zone, set()).add(stream)
        try:
            yield stream
        finally:
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

    def note(self, zone: str) -> None:
        """There is news of `zone`; called in the event loop."""
        for stream in self._open.get(EVERY_ZONE, ()):
            stream.put([Event(zone, b"")])

    def add(self, zone: str) -> None:
        """A zone has come; its streams are opened by its clients."""
        self._in_loop(self.note, zone)

    def remove(self, zone: str) -> None:
        """End the streams of `zone`."""
        self.ahead.pop(zone, None)
        self._in_loop(self.note, zone)
        self._in_loop(self.end, zone)

    def publish(self, announcement: Announcement) -> None:
        """Leave what is announced for the clients of its zone."""
        zone, ahead = announcement.zone, announcement.reports.ahead
        if ahead is not None:
            self.ahead[zone] = ahead
        if zone in self._open:
            read = {stream.language for stream in tuple(self._open.get(zone, ()))}
            self._in_loop(self._leave, zone, {language: events_of(announcement, language) for language in read})
        if EVERY_ZONE in self._open:
            self._in_loop(self.note, zone)

    def measures(self) -> list[Measure]:
        """What clients were too slow for; how many streams are open is counted where that is bounded."""
        return [Measure.called("thermogate_stream_events_overtaken", lambda: single(float(self.overtaken)))]

    def close(self) -> None:
        """End all streams, for good."""
        self._in_loop(self.end)

    def _in_loop(self, work: Callable[..., object], *arguments: object) -> None:
        # Where the loop is gone, so are the clients.
        if self._loop is not None:
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(work, *arguments)

    def _leave(self, zone: str, events: dict[str, list[Event]]) -> None:
        for stream in self._open.get(zone, ()):
            # One that was opened meanwhile in another language begins with the state of now.
            self.overtaken += stream.put(events.get(stream.language, ()))
